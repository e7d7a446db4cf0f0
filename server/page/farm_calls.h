#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "lumifold/v1/farm.pb.h"

namespace grpc {
class ClientContext;
}  // namespace grpc

namespace google::protobuf {
class Message;
}  // namespace google::protobuf

namespace lumifold::page {

/// Calls of FarmService in the name of the owner of a session, as any client makes them: they pass the same
/// gate.
/// Threads: safe; calls block.
class FarmCalls {
 public:
  /// `channel`: to the coordinator within the process.
  explicit FarmCalls(std::shared_ptr<grpc::Channel> channel) : channel_(std::move(channel)) {}

  /// Makes a unary call that the page may make, see farm_calls.cc, with a request and an answer in JSON: with
  /// the names of the fields in the protocol, all of them.
  /// Errors: kNotFound for another call; kInvalidArgument for what is no request; those of the call.
  absl::StatusOr<std::string> CallInJson(const v1::PageSession& session, const std::string& method,
                                         const std::string& request) const;
  /// Makes a unary call. Errors: those of the call.
  absl::Status Call(const v1::PageSession& session, const std::string& method,
                    const google::protobuf::Message& request, google::protobuf::Message* response) const;

  /// For streams, whose calls need it too.
  static void NameCaller(const v1::PageSession& session, grpc::ClientContext* context);
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  const std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace lumifold::page
