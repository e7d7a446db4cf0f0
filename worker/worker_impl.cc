#include "worker/worker_impl.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <random>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "spdlog/spdlog.h"
#include "worker/unit_messages.h"

namespace lumifold::worker {
namespace {

bool IsLease(const v1::Lease& lease, const v1::UnitId& unit, int64_t attempt) {
  const v1::UnitId& own = lease.unit();
  return lease.attempt() == attempt && own.job_id() == unit.job_id() && own.frame() == unit.frame() &&
         own.tile() == unit.tile() && own.pass() == unit.pass() && own.kind() == unit.kind();
}

std::string Describe(const v1::UnitId& unit) {
  if (unit.kind() == v1::UNIT_KIND_PLAN) return absl::StrCat("job=", unit.job_id(), " kind=plan");
  return absl::StrCat("job=", unit.job_id(), " frame=", unit.frame(), " tile=", unit.tile(),
                      " pass=", unit.pass(),
                      " kind=", unit.kind() == v1::UNIT_KIND_GEOMETRY ? "geometry" : "pass");
}

void SendFailure(const v1::Lease& lease, const absl::Status& failure, Outbox* outbox) {
  v1::WorkerMessage message;
  v1::UnitFailure* out = message.mutable_failure();
  *out->mutable_unit() = lease.unit();
  out->set_attempt(lease.attempt());
  out->set_error(rpc::BoundedLine(std::string(failure.message()), rpc::kMaxErrorBytes));
  out->set_permanent(IsPermanent(failure));
  if (std::optional<v1::AssetRef> missing = MissingAsset(failure))
    *out->mutable_missing_asset() = *std::move(missing);
  outbox->Send(std::move(message));
}

uint64_t RandomInstance() {
  std::random_device source;
  return std::uniform_int_distribution<uint64_t>(1, std::numeric_limits<uint64_t>::max())(source);
}

}  // namespace

WorkerImpl::WorkerImpl(int threads, SpecCache* specs, UnitRenderer* renderer,
                       std::shared_ptr<spdlog::logger> log)
    : specs_(specs),
      renderer_(renderer),
      log_(std::move(log)),
      instance_(RandomInstance()),
      idle_since_(rpc::MonotonicNow()) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { RunThread(); });
}

WorkerImpl::~WorkerImpl() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
    RemoveHeld([](const v1::Lease&) { return true; });
  }
  renderer_->StopLoading();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerImpl::OnConnected(std::shared_ptr<Outbox> outbox) {
  absl::MutexLock lock(&mutex_);
  outbox_ = std::move(outbox);
}

void WorkerImpl::OnDisconnected() {
  absl::MutexLock lock(&mutex_);
  outbox_ = nullptr;
  newest_attempt_ = 0;
  waiting_.clear();
  RemoveHeld([](const v1::Lease&) { return true; });
  specs_->Clear();
}

void WorkerImpl::OnMessage(const v1::CoordinatorMessage& message) {
  absl::MutexLock lock(&mutex_);
  switch (message.message_case()) {
    case v1::CoordinatorMessage::kGrant:
      return OnGrant(message.grant());
    case v1::CoordinatorMessage::kAck:
      return OnAck(message.ack());
    case v1::CoordinatorMessage::kJobEnded:
      return OnJobEnded(message.job_ended().job_id());
    case v1::CoordinatorMessage::kVoidLeases:
      return OnVoidLeases(message.void_leases());
    case v1::CoordinatorMessage::kDrain:
      return BeginToLeave("drained");
    case v1::CoordinatorMessage::kReleased:
      released_ = true;
      return;
    default:
      return;  // Welcome is handled by the connection
  }
}

void WorkerImpl::OnGrant(const v1::Grant& grant) {
  for (const v1::Lease& lease : grant.leases()) {
    newest_attempt_ = std::max(newest_attempt_, lease.attempt());
    held_.push_back(lease);
    waiting_.push_back(lease);
  }
  // The coordinator has not heard yet that this worker leaves.
  if (leaving_) HandBackWaiting();
}

template <typename Condition>
void WorkerImpl::RemoveHeld(Condition condition) {
  const auto is_removed = [&](const v1::Lease& lease) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!condition(lease)) return false;
    const auto taken = taken_.find(lease.attempt());
    if (taken != taken_.end()) {
      past_progress_ += taken->second->control.progress;
      taken->second->control.stop = true;
      taken_.erase(taken);
    }
    return true;
  };
  std::erase_if(waiting_, [&](const v1::Lease& lease) { return condition(lease); });
  if (std::erase_if(held_, is_removed) > 0 && held_.empty()) idle_since_ = rpc::MonotonicNow();
}

template <typename Condition>
void WorkerImpl::HandBack(Condition condition) {
  v1::WorkerMessage message;
  for (const v1::Lease& lease : held_) {
    if (condition(lease)) *message.mutable_hand_back()->add_leases() = lease;
  }
  if (message.hand_back().leases().empty()) return;
  log_->info("event=leases_handed_back leases={}", message.hand_back().leases_size());
  std::set<int64_t> attempts;
  for (const v1::Lease& lease : message.hand_back().leases()) attempts.insert(lease.attempt());
  RemoveHeld([&](const v1::Lease& lease) { return attempts.contains(lease.attempt()); });
  if (outbox_ != nullptr) outbox_->Send(std::move(message));
}

void WorkerImpl::HandBackWaiting() {
  HandBack([this](const v1::Lease& lease)
               ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !taken_.contains(lease.attempt()); });
}

void WorkerImpl::OnAck(const v1::UnitAck& ack) {
  if (!ack.refused().empty())
    log_->error("event=unit_refused {} reason=\"{}\"", Describe(ack.unit()), ack.refused());
  RemoveHeld([&](const v1::Lease& held) { return IsLease(held, ack.unit(), ack.attempt()); });
}

void WorkerImpl::OnVoidLeases(const v1::VoidLeases& message) {
  for (const v1::Lease& lease : message.leases()) {
    log_->info("event=lease_void {}", Describe(lease.unit()));
    RemoveHeld([&](const v1::Lease& held) { return IsLease(held, lease.unit(), lease.attempt()); });
  }
}

void WorkerImpl::OnJobEnded(const std::string& job_id) {
  RemoveHeld([&](const v1::Lease& lease) { return lease.unit().job_id() == job_id; });
  specs_->Forget(job_id);
  renderer_->ForgetJob(job_id);
}

v1::Heartbeat WorkerImpl::MakeHeartbeat() const {
  absl::MutexLock lock(&mutex_);
  v1::Heartbeat heartbeat;
  int64_t all = past_progress_;
  for (const auto& [attempt, taken] : taken_) all += taken->control.progress;
  for (const v1::Lease& lease : held_) {
    const auto own = taken_.find(lease.attempt());
    *heartbeat.add_held() = lease;
    heartbeat.mutable_held()->rbegin()->set_progress(
        own == taken_.end() ? all : own->second->control.progress.load());
  }
  heartbeat.set_newest_attempt(newest_attempt_);
  return heartbeat;
}

void WorkerImpl::Leave(const std::string& reason) {
  absl::MutexLock lock(&mutex_);
  BeginToLeave(reason);
}

void WorkerImpl::BeginToLeave(const std::string& reason) {
  if (leaving_) return;
  leaving_ = true;
  log_->info("event=leaving reason={} leases={}", reason, held_.size());
  v1::WorkerMessage message;
  message.mutable_leaving()->set_reason(reason);
  if (outbox_ != nullptr) outbox_->Send(std::move(message));
  HandBackWaiting();
}

bool WorkerImpl::IsLeaving() const {
  absl::MutexLock lock(&mutex_);
  return leaving_;
}

void WorkerImpl::HandBackUnfinished() {
  absl::MutexLock lock(&mutex_);
  HandBack([this](const v1::Lease& lease) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto taken = taken_.find(lease.attempt());
    return taken == taken_.end() || !taken->second->is_delivered;
  });
}

bool WorkerImpl::HasLeft() const {
  absl::MutexLock lock(&mutex_);
  return leaving_ && released_ && held_.empty();
}

absl::Time WorkerImpl::IdleSince() const {
  absl::MutexLock lock(&mutex_);
  return held_.empty() ? idle_since_ : absl::InfiniteFuture();
}

void WorkerImpl::RunThread() {
  while (true) {
    v1::Lease lease;
    const auto taken = std::make_shared<Taken>();
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &WorkerImpl::HasWorkOrStops));
      if (stopping_) return;
      lease = std::move(waiting_.front());
      waiting_.pop_front();
      taken_[lease.attempt()] = taken;
    }
    RenderAndSend(lease, taken.get());
  }
}

absl::StatusOr<RenderedUnit> WorkerImpl::Render(const v1::Lease& lease, UnitControl* control) {
  const std::string& job_id = lease.unit().job_id();
  const absl::StatusOr<std::shared_ptr<const v1::JobSpec>> spec = specs_->Get(job_id, lease.unit().kind());
  if (spec.ok()) return renderer_->Render(**spec, lease, control);
  if (absl::IsNotFound(spec.status())) {
    // The job has ended, and JobEnded is on its way.
    absl::MutexLock lock(&mutex_);
    OnJobEnded(job_id);
  }
  return spec.status();
}

void WorkerImpl::RenderAndSend(const v1::Lease& lease, Taken* taken) {
  const absl::StatusOr<RenderedUnit> unit = Render(lease, &taken->control);
  const std::shared_ptr<Outbox> outbox = BeginDelivery(lease, taken);
  if (outbox == nullptr) return;
  if (!unit.ok()) {
    log_->error("event=unit_failed {} error=\"{}\"", Describe(lease.unit()),
                std::string(unit.status().message()));
    // In this order: a heartbeat in between must not make the coordinator think that the lease was dropped.
    SendFailure(lease, unit.status(), outbox.get());
    absl::MutexLock lock(&mutex_);
    RemoveHeld([&](const v1::Lease& held) { return IsLease(held, lease.unit(), lease.attempt()); });
    return;
  }
  log_->debug("event=unit_rendered {} seconds={:.3f}", Describe(lease.unit()), unit->stats.seconds());
  SendUnit(lease, *unit, [&outbox](v1::WorkerMessage message) { outbox->Send(std::move(message)); });
}

std::shared_ptr<Outbox> WorkerImpl::BeginDelivery(const v1::Lease& lease, Taken* taken) {
  absl::MutexLock lock(&mutex_);
  const auto found = taken_.find(lease.attempt());
  if (found == taken_.end() || found->second.get() != taken) return nullptr;
  taken->is_delivered = true;
  return outbox_;
}

}  // namespace lumifold::worker
