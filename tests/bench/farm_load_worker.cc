#include "tests/bench/farm_load_worker.h"

#include <grpcpp/impl/codegen/proto_utils.h>

#include <algorithm>
#include <utility>

#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/version.h"
#include "worker/render/renderer.h"

namespace lumifold::bench {
namespace {

constexpr size_t kMaxErrors = 10;
/// More than any frame needs.
constexpr uint64_t kManyBytes = uint64_t{1} << 40;

/// A channel that shares its connection with no other.
std::shared_ptr<grpc::Channel> OwnChannel(const std::string& address, const rpc::Security& security) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(rpc::kMaxMessageBytes);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address, rpc::MakeChannelCredentials(security), arguments);
}

grpc::ByteBuffer Serialised(const v1::WorkerMessage& message) {
  const grpc::Slice slice(message.SerializeAsString());
  return {&slice, 1};
}

grpc::ByteBuffer KeptMessage(const v1::Lease& lease) {
  v1::WorkerMessage message;
  *message.mutable_kept()->mutable_unit() = lease.unit();
  message.mutable_kept()->set_attempt(lease.attempt());
  return Serialised(message);
}

std::vector<double> Sorted(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values;
}

}  // namespace

void LoadCounters::StartTiming() {
  absl::MutexLock lock(&mutex_);
  timing_ = true;
}

void LoadCounters::StopTiming() {
  absl::MutexLock lock(&mutex_);
  timing_ = false;
}

void LoadCounters::AddLease(absl::Duration free_to_lease) {
  absl::MutexLock lock(&mutex_);
  if (timing_) lease_ms_.push_back(absl::ToDoubleMilliseconds(free_to_lease));
}

void LoadCounters::AddCommit(absl::Duration delivered_to_acknowledged) {
  absl::MutexLock lock(&mutex_);
  if (timing_) commit_ms_.push_back(absl::ToDoubleMilliseconds(delivered_to_acknowledged));
}

std::vector<double> LoadCounters::lease_ms() const {
  absl::MutexLock lock(&mutex_);
  return Sorted(lease_ms_);
}

std::vector<double> LoadCounters::commit_ms() const {
  absl::MutexLock lock(&mutex_);
  return Sorted(commit_ms_);
}

void LoadCounters::AddError(const std::string& error) {
  absl::MutexLock lock(&mutex_);
  if (errors_.size() < kMaxErrors) errors_.push_back(error);
}

std::vector<std::string> LoadCounters::errors() const {
  absl::MutexLock lock(&mutex_);
  return errors_;
}

LoadWorker::LoadWorker(const std::string& address, const rpc::Security& security, const std::string& name,
                       int slots, ReadyUnits* units, const ReadyResults* results, LoadCounters* counters)
    : units_(units),
      results_(results),
      counters_(counters),
      channel_(OwnChannel(address, security)),
      stub_(channel_),
      calls_(channel_) {
  v1::WorkerMessage message;
  message.mutable_hello()->set_name(name);
  message.mutable_hello()->set_numeric_class(results == nullptr ? "load" : render::NumericClass());
  if (results != nullptr) {
    message.mutable_hello()->set_finishes(1);
    message.mutable_hello()->set_finish_memory_bytes(kManyBytes);
    message.mutable_hello()->set_keep_bytes(kManyBytes);
  }
  message.mutable_hello()->set_slots(slots);
  message.mutable_hello()->set_wire_version(rpc::kWireVersion);
  context_.set_wait_for_ready(true);
  stub_.PrepareBidiStreamingCall(&context_, "/lumifold.v1.WorkerService/Work", {}, this);
  AddHold();  // until a read fails: writes are started from other threads too
  StartRead(&incoming_);
  StartCall();
  absl::MutexLock lock(&mutex_);
  Send(Serialised(message));
}

LoadWorker::~LoadWorker() {
  Cancel();
  done_.WaitForNotification();
}

void LoadWorker::SendHeartbeat() {
  v1::WorkerMessage message;
  absl::MutexLock lock(&mutex_);
  ++progress_;
  for (const auto& [attempt, delivered] : delivered_) {
    v1::Lease* held = message.mutable_heartbeat()->add_held();
    *held = delivered.lease;
    held->set_progress(progress_);
  }
  message.mutable_heartbeat()->set_newest_attempt(newest_attempt_);
  Send(Serialised(message));
}

void LoadWorker::Send(grpc::ByteBuffer message) {
  if (closed_) return;
  outgoing_.push_back(std::move(message));
  if (outgoing_.size() == 1) StartWrite(&outgoing_.front());
}

void LoadWorker::OnWriteDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  outgoing_.pop_front();
  if (!ok || closed_) {
    outgoing_.clear();
    closed_ = true;
    return;
  }
  if (!outgoing_.empty()) StartWrite(&outgoing_.front());
}

void LoadWorker::OnReadDone(bool ok) {
  v1::CoordinatorMessage message;
  if (!ok || !grpc::SerializationTraits<v1::CoordinatorMessage>::Deserialize(&incoming_, &message).ok()) {
    {
      absl::MutexLock lock(&mutex_);
      closed_ = true;
    }
    RemoveHold();
    return;
  }
  if (message.has_welcome()) {
    absl::MutexLock lock(&mutex_);
    id_ = message.welcome().worker_id();
    ++counters_->welcomed;
  }
  if (message.has_grant()) OnGrant(message.grant());
  if (message.has_ack()) OnAck(message.ack());
  StartRead(&incoming_);
}

void LoadWorker::OnGrant(const v1::Grant& grant) {
  const absl::Time now = rpc::MonotonicNow();
  for (const v1::Lease& lease : grant.leases()) {
    if (lease.unit().kind() == v1::UNIT_KIND_RESULT) {
      Finish(lease);
    } else {
      Answer(lease, now);
    }
  }
}

void LoadWorker::Answer(const v1::Lease& lease, absl::Time now) {
  std::vector<grpc::ByteBuffer> messages =
      lease.keep() ? std::vector<grpc::ByteBuffer>{KeptMessage(lease)} : units_->MessagesFor(lease);
  absl::MutexLock lock(&mutex_);
  newest_attempt_ = std::max(newest_attempt_, lease.attempt());
  if (!free_since_.empty()) {
    counters_->AddLease(now - free_since_.front());
    free_since_.pop_front();
  }
  Delivered& delivered = delivered_[lease.attempt()];
  delivered = {lease, now};
  for (grpc::ByteBuffer& message : messages) {
    delivered.bytes += static_cast<int64_t>(message.Length());
    Send(std::move(message));
  }
}

void LoadWorker::Finish(const v1::Lease& lease) {
  std::string id;
  {
    absl::MutexLock lock(&mutex_);
    newest_attempt_ = std::max(newest_attempt_, lease.attempt());
    delivered_[lease.attempt()] = {lease, rpc::MonotonicNow()};
    id = id_;
  }
  finisher_.Run([this, id, lease] {
    const absl::Status status = results_->Finish(&calls_, id, lease);
    if (!status.ok()) counters_->AddError("frame: " + std::string(status.message()));
    absl::MutexLock lock(&mutex_);
    delivered_.erase(lease.attempt());
    ++counters_->finished;
    if (lease.keep()) ++counters_->kept;
  });
}

void LoadWorker::OnAck(const v1::UnitAck& ack) {
  const absl::Time now = rpc::MonotonicNow();
  if (!ack.refused().empty()) {
    ++counters_->refused;
    counters_->AddError("unit refused: " + ack.refused());
  }
  absl::MutexLock lock(&mutex_);
  const auto found = delivered_.find(ack.attempt());
  if (found == delivered_.end()) return;
  counters_->AddCommit(now - found->second.at);
  ++counters_->committed;
  counters_->committed_bytes += found->second.bytes;
  delivered_.erase(found);
  free_since_.push_back(now);
}

void LoadWorker::OnDone(const grpc::Status& status) {
  if (status.error_code() != grpc::StatusCode::CANCELLED)
    counters_->AddError("a stream ended: " + status.error_message());
  ++counters_->ended;
  done_.Notify();
}

}  // namespace lumifold::bench
