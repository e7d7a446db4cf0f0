#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/status_codec.h"
#include "server/services/call_gate.h"

/// What the adapters of all services share: the gate that their calls pass, and the way in which unary calls
/// are answered.
namespace lumifold::server {

using AdmittedCall = std::unique_ptr<CallGate::Call>;

/// Takes the result of a call, from any thread.
template <typename Response>
using Done = std::function<void(absl::StatusOr<Response>)>;

/// Makes a unary call that has passed the gate: `start` gets the call and what takes its result.
template <typename Response, typename Start>
grpc::ServerUnaryReactor* AnswerLater(grpc::CallbackServerContext* context,
                                      absl::StatusOr<AdmittedCall> admitted, Response* response,
                                      Start start) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (!admitted.ok()) {
    reactor->Finish(rpc::GrpcFromStatus(admitted.status()));
    return reactor;
  }
  const std::shared_ptr<CallGate::Call> call = *std::move(admitted);
  start(*call, Done<Response>([call, reactor, response](absl::StatusOr<Response> result) {
    const absl::Status status = result.status();
    if (result.ok()) *response = *std::move(result);
    call->End(status);
    reactor->Finish(rpc::GrpcFromStatus(status));
  }));
  return reactor;
}

/// The same for a call that has its result at once.
template <typename Response, typename Make>
grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, absl::StatusOr<AdmittedCall> admitted,
                                 Response* response, Make make) {
  return AnswerLater(context, std::move(admitted), response,
                     [&make](const CallGate::Call& call, const Done<Response>& done) {
                       done(absl::StatusOr<Response>(make(call)));
                     });
}

/// The calls of one service, as the gate sees them.
class ServiceGate {
 public:
  ServiceGate(CallGate* gate, std::string service) : gate_(gate), service_(std::move(service)) {}

  absl::StatusOr<AdmittedCall> Admit(const grpc::CallbackServerContext* context, const char* method,
                                     const std::string& subject) const {
    return gate_->Admit(*context, PathOf(method), subject);
  }
  absl::StatusOr<AdmittedCall> AdmitStream(grpc::CallbackServerContext* context, const char* method,
                                           const std::string& subject) const {
    return gate_->AdmitStream(context, PathOf(method), subject);
  }

  std::string PathOf(const char* method) const { return absl::StrCat("/", service_, "/", method); }

 private:
  CallGate* const gate_;
  const std::string service_;
};

}  // namespace lumifold::server
