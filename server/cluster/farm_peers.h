#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/server_context.h>

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/status_codec.h"
#include "server/access/forward_seal.h"
#include "server/access/identity.h"
#include "server/cluster/membership.h"

namespace lumifold::cluster {

/// The other coordinators of a farm, as those see them that answer calls: a call about a job goes to the
/// coordinator that owns it, in the name of its caller. A forwarded call is not forwarded again, so that
/// coordinators that disagree about an owner cannot send it in circles.
/// Threads: safe.
class FarmPeers {
 public:
  struct Options {
    /// For connections to the others: plain text, or the authority.
    rpc::Security security;
    /// Null in plain text.
    const access::ForwardSeal* seal = nullptr;
    std::function<absl::Time()> wall_now;
    /// This coordinator, and the owner of a job. Errors: those of JobStore::GetJob.
    ledger::Epoch self;
    std::function<absl::StatusOr<ledger::Epoch>(const job::JobId&)> owner_of;
  };
  /// The others, from now on. Null, as at the start: there are none.
  void Join(Options options, const Membership* membership);

  /// All members; empty where there are no others.
  std::vector<ledger::Member> Members() const;

  /// Whether the call may go on to another coordinator: there are some, and it was not forwarded.
  bool MayForward(const grpc::CallbackServerContext& context) const;

  /// Another coordinator.
  struct Peer {
    std::string address;
    std::shared_ptr<grpc::Channel> channel;
  };
  /// The owner of a job; without a channel: this coordinator, also for a call that was forwarded, and for a
  /// job that is not known. Errors: those of JobStore::GetJob; kUnavailable where the owner is gone and
  /// nobody has the job yet.
  absl::StatusOr<Peer> OwnerOf(const grpc::CallbackServerContext& context, const std::string& job_id);
  /// Errors: kNotFound for no member.
  absl::StatusOr<Peer> PeerOf(ledger::Epoch epoch);

  /// Until when a call waits for an owner: less than its client does.
  static absl::Time Patience(const grpc::CallbackServerContext& context);
  /// Calls `next` on another thread, after a part of the time in which a lost coordinator's jobs are taken
  /// over.
  static void AfterPause(std::function<void()> next);

  /// Adds to the context of a forwarded call whose it is and of which trace, and of a unary one when it ends.
  void PrepareStream(const access::Identity& caller, const std::string& trace_parent,
                     grpc::ClientContext* to) const;
  void Prepare(const grpc::CallbackServerContext& from, const access::Identity& caller,
               grpc::ClientContext* to) const;
  /// Makes a unary call at a peer, which has some seconds to answer, less than clients wait. `path`:
  /// "/lumifold.v1.FarmService/GetJob". `request` need not outlive the call.
  template <typename Response, typename Request>
  void Forward(const Peer& peer, const std::string& path, const grpc::CallbackServerContext& from,
               const access::Identity& caller, const Request& request,
               std::function<void(absl::StatusOr<Response>)> done) const;

  /// The error of a forwarded call: kUnavailable naming the peer where that does not answer.
  static absl::Status ErrorOf(const std::string& address, const absl::Status& status);

 private:
  const Membership* membership() const {
    absl::MutexLock lock(&mutex_);
    return membership_;
  }
  Peer ConnectTo(const std::string& address) ABSL_LOCKS_EXCLUDED(mutex_);

  mutable absl::Mutex mutex_;
  Options options_ ABSL_GUARDED_BY(mutex_);
  const Membership* membership_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::map<std::string, std::shared_ptr<grpc::Channel>> channels_ ABSL_GUARDED_BY(mutex_);
};

template <typename Response, typename Request>
void FarmPeers::Forward(const Peer& peer, const std::string& path, const grpc::CallbackServerContext& from,
                        const access::Identity& caller, const Request& request,
                        std::function<void(absl::StatusOr<Response>)> done) const {
  struct Call {
    Call(const Request& sent, const Peer& peer) : address(peer.address), request(sent), stub(peer.channel) {}

    const std::string address;
    grpc::ClientContext context;
    const Request request;
    Response response;
    grpc::TemplatedGenericStub<Request, Response> stub;
  };
  const auto call = std::make_shared<Call>(request, peer);
  Prepare(from, caller, &call->context);
  call->stub.UnaryCall(&call->context, path, {}, &call->request, &call->response,
                       [call, done = std::move(done)](const grpc::Status& status) {
                         if (!status.ok()) return done(ErrorOf(call->address, rpc::StatusFromGrpc(status)));
                         done(std::move(call->response));
                       });
}

}  // namespace lumifold::cluster
