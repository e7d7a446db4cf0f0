#include "server/cluster/farm_peers.h"

#include <grpcpp/alarm.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::cluster {
namespace {

/// Of a forwarded call: less than clients wait for a try, so that they get an answer if the peer gives none.
constexpr absl::Duration kLongestCall = absl::Seconds(8);

/// Of the time that a client has, so that it gets an answer before it gives up.
constexpr double kShareOfDeadline = 0.8;
constexpr absl::Duration kOwnerPause = absl::Milliseconds(200);

}  // namespace

void FarmPeers::Join(Options options, const Membership* membership) {
  absl::MutexLock lock(&mutex_);
  options_ = std::move(options);
  membership_ = membership;
}

std::vector<ledger::Member> FarmPeers::Members() const {
  const Membership* const farm = membership();
  return farm == nullptr ? std::vector<ledger::Member>() : farm->members();
}

bool FarmPeers::MayForward(const grpc::CallbackServerContext& context) const {
  return membership() != nullptr && context.client_metadata().count(access::kForwardedKey) == 0;
}

absl::StatusOr<FarmPeers::Peer> FarmPeers::OwnerOf(const grpc::CallbackServerContext& context,
                                                   const std::string& job_id) {
  if (!MayForward(context)) return Peer();
  Options options;
  {
    absl::MutexLock lock(&mutex_);
    options = options_;
  }
  const absl::StatusOr<ledger::Epoch> owner = options.owner_of(job::JobId(job_id));
  if (absl::IsNotFound(owner.status())) return Peer();  // the answer says so
  if (!owner.ok()) return owner.status();
  if (*owner == options.self) return Peer();
  absl::StatusOr<Peer> peer = PeerOf(*owner);
  if (!absl::IsNotFound(peer.status())) return peer;
  return absl::UnavailableError(
      absl::StrCat("the coordinator of job ", job_id, " is gone; another one takes the job over"));
}

absl::StatusOr<FarmPeers::Peer> FarmPeers::PeerOf(ledger::Epoch epoch) {
  const std::vector<ledger::Member> members = Members();
  const auto found = std::find_if(members.begin(), members.end(), [epoch](const ledger::Member& member) {
    return member.owner.epoch == epoch;
  });
  if (found == members.end()) return absl::NotFoundError("no such coordinator");
  return ConnectTo(found->address);
}

FarmPeers::Peer FarmPeers::ConnectTo(const std::string& address) {
  absl::MutexLock lock(&mutex_);
  std::shared_ptr<grpc::Channel>& channel = channels_[address];
  if (channel == nullptr) channel = rpc::MakeChannel(address, options_.security, rpc::kQuickKeepAlive);
  return {address, channel};
}

absl::Time FarmPeers::Patience(const grpc::CallbackServerContext& context) {
  return rpc::MonotonicNow() +
         std::min(rpc::TimeUntil(context.raw_deadline()) * kShareOfDeadline, kLongestCall);
}

void FarmPeers::AfterPause(std::function<void()> next) {
  auto* const alarm = new grpc::Alarm();
  alarm->Set(rpc::MonotonicDeadline(kOwnerPause), [alarm, next = std::move(next)](bool) {
    next();
    delete alarm;
  });
}

absl::Status FarmPeers::ErrorOf(const std::string& address, const absl::Status& status) {
  if (!absl::IsUnavailable(status) && !absl::IsDeadlineExceeded(status)) return status;
  return absl::UnavailableError(
      absl::StrCat("the coordinator at ", address, " does not answer: ", status.message()));
}

void FarmPeers::Prepare(const grpc::CallbackServerContext& from, const access::Identity& caller,
                        grpc::ClientContext* to) const {
  to->set_deadline(rpc::MonotonicDeadline(std::min(rpc::TimeUntil(from.raw_deadline()), kLongestCall)));
  PrepareStream(caller, rpc::SentTraceParent(from), to);
}

void FarmPeers::PrepareStream(const access::Identity& caller, const std::string& trace_parent,
                              grpc::ClientContext* to) const {
  if (!trace_parent.empty()) to->AddMetadata(rpc::kTraceParentKey, trace_parent);
  absl::MutexLock lock(&mutex_);
  to->AddMetadata(access::kForwardedKey,
                  options_.seal == nullptr ? "plain" : options_.seal->Make(caller.id, options_.wall_now()));
}

}  // namespace lumifold::cluster
