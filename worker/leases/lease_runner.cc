#include "worker/leases/lease_runner.h"

#include <limits>
#include <new>
#include <optional>
#include <random>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/trace_context.h"
#include "spdlog/spdlog.h"
#include "worker/scene/out_of_memory.h"
#include "worker/units/unit_messages.h"

namespace lumifold::worker {
namespace {

std::string Describe(const v1::UnitId& unit) {
  if (unit.kind() == v1::UNIT_KIND_PLAN) return absl::StrCat("job=", unit.job_id(), " kind=plan");
  if (unit.kind() == v1::UNIT_KIND_RESULT)
    return absl::StrCat("job=", unit.job_id(), " frame=", unit.frame(), " kind=result");
  if (unit.kind() == v1::UNIT_KIND_BLOCK)
    return absl::StrCat("job=", unit.job_id(), " frame=", unit.frame(), " block=", unit.tile(),
                        " kind=block");
  if (unit.kind() == v1::UNIT_KIND_ESTIMATE)
    return absl::StrCat("job=", unit.job_id(), " frame=", unit.frame(), " round=", unit.pass(),
                        " kind=estimate");
  return absl::StrCat("job=", unit.job_id(), " frame=", unit.frame(), " tile=", unit.tile(),
                      " pass=", unit.pass(),
                      " kind=", unit.kind() == v1::UNIT_KIND_GEOMETRY ? "geometry" : "pass");
}

void SendFailure(const v1::Lease& lease, const absl::Status& failure, std::vector<v1::LogEvent> log,
                 Outbox* outbox) {
  v1::WorkerMessage message;
  v1::UnitFailure* out = message.mutable_failure();
  *out->mutable_unit() = lease.unit();
  out->set_attempt(lease.attempt());
  out->set_error(rpc::BoundedLine(std::string(failure.message()), rpc::kMaxErrorBytes));
  out->set_permanent(IsPermanent(failure));
  out->set_out_of_memory(scene::IsOutOfMemory(failure));
  if (std::optional<v1::AssetRef> missing = MissingAsset(failure))
    *out->mutable_missing_asset() = *std::move(missing);
  for (v1::LogEvent& line : log) *out->add_log() = std::move(line);
  outbox->Send(std::move(message));
}

// Why a unit failed.
constexpr char kMissingAsset[] = "missing_asset";
constexpr char kPermanent[] = "permanent";
constexpr char kRefused[] = "refused";
constexpr char kTransient[] = "transient";
constexpr char kOutOfMemory[] = "out_of_memory";

const char* ReasonOf(const absl::Status& failure) {
  if (MissingAsset(failure).has_value()) return kMissingAsset;
  if (scene::IsOutOfMemory(failure)) return kOutOfMemory;
  return IsPermanent(failure) ? kPermanent : kTransient;
}

uint64_t RandomInstance() {
  std::random_device source;
  return std::uniform_int_distribution<uint64_t>(1, std::numeric_limits<uint64_t>::max())(source);
}

}  // namespace

LeaseRunner::LeaseRunner(int threads, SpecCache* specs, UnitRenderer* renderer, WorkerLog log,
                         FrameWork frames)
    : specs_(specs),
      renderer_(renderer),
      frames_(std::move(frames)),
      log_(std::move(log)),
      instance_(RandomInstance()),
      activities_(threads, rpc::MonotonicNow()),
      units_(rpc::MonotonicNow()) {
  totals_.failures = {{kMissingAsset, 0}, {kOutOfMemory, 0}, {kPermanent, 0}, {kRefused, 0}, {kTransient, 0}};
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { RunThread(); });
}

LeaseRunner::~LeaseRunner() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
    units_.RemoveHeld([](const v1::Lease&) { return true; });
  }
  renderer_->StopLoading();
  for (std::thread& thread : threads_) thread.join();
  for (const auto& [job_id, spent] : account_.CloseAll()) LogAccount(job_id, spent);
}

void LeaseRunner::LogAccount(const std::string& job_id, absl::Duration spent) const {
  if (spent == absl::ZeroDuration()) return;
  log_.log->info("event=job_account job={} core_seconds={:.3f}", job_id, absl::ToDoubleSeconds(spent));
}

void LeaseRunner::OnConnected(std::shared_ptr<Outbox> outbox) {
  absl::MutexLock lock(&mutex_);
  outbox_ = std::move(outbox);
}

void LeaseRunner::OnDisconnected() {
  absl::MutexLock lock(&mutex_);
  outbox_ = nullptr;
  rest_.clear();
  units_.LoseConnection();
  specs_->Clear();
}

void LeaseRunner::OnMessage(const v1::CoordinatorMessage& message) {
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
      return OnDrain(message.drain());
    case v1::CoordinatorMessage::kReleased:
      leave_.released = true;
      return;
    case v1::CoordinatorMessage::kMove:
      return OnMove(message.move());
    default:
      return;  // Welcome is handled by the connection
  }
}

void LeaseRunner::OnGrant(const v1::Grant& grant) {
  for (const v1::Lease& lease : grant.leases()) {
    if (rpc::IsTraceId(grant.trace_id()))
      log_.labels->Set(lease.unit().job_id(), {.trace = grant.trace_id()});
    units_.Add(lease);
  }
  // At once, before a thread begins: only a unit that was received can end the worker.
  if (outbox_ != nullptr) {
    v1::WorkerMessage answer;
    *answer.mutable_heartbeat()->mutable_held() = grant.leases();
    outbox_->Send(std::move(answer));
  }
  // The coordinator has not heard yet that this worker leaves or rests.
  if (leave_.leaving || leave_.move.has_value() || !rest_.empty()) HandBackWaiting();
}

template <typename Condition>
void LeaseRunner::HandBack(Condition condition) {
  v1::WorkerMessage message;
  for (const v1::Lease& lease : units_.held()) {
    if (condition(lease)) *message.mutable_hand_back()->add_leases() = lease;
  }
  if (message.hand_back().leases().empty()) return;
  log_.log->info("event=leases_handed_back leases={}", message.hand_back().leases_size());
  std::set<int64_t> attempts;
  for (const v1::Lease& lease : message.hand_back().leases()) attempts.insert(lease.attempt());
  units_.RemoveHeld([&](const v1::Lease& lease) { return attempts.contains(lease.attempt()); });
  if (outbox_ != nullptr) outbox_->Send(std::move(message));
}

void LeaseRunner::HandBackWaiting() {
  HandBack([this](const v1::Lease& lease)
               ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !units_.IsTaken(lease); });
}

void LeaseRunner::OnAck(const v1::UnitAck& ack) {
  if (!ack.refused().empty()) {
    ++totals_.failures[kRefused];
    log_.log->error("event=unit_refused {} reason={}", Describe(ack.unit()), logging::Quoted(ack.refused()));
  }
  units_.RemoveHeld([&](const v1::Lease& held) { return IsLease(held, ack.unit(), ack.attempt()); });
}

void LeaseRunner::OnVoidLeases(const v1::VoidLeases& message) {
  for (const v1::Lease& lease : message.leases()) {
    log_.log->info("event=lease_void {}", Describe(lease.unit()));
    if (lease.keep()) units_.kept().Drop(lease.unit());
    units_.RemoveHeld([&](const v1::Lease& own) { return IsLease(own, lease.unit(), lease.attempt()); });
  }
}

void LeaseRunner::OnJobEnded(const std::string& job_id) {
  units_.RemoveHeld([&](const v1::Lease& lease) { return lease.unit().job_id() == job_id; });
  units_.kept().DropJob(job_id);
  specs_->Forget(job_id);
  renderer_->ForgetJob(job_id);
  LogAccount(job_id, account_.Close(job_id));
}

v1::Heartbeat LeaseRunner::MakeHeartbeat() const {
  absl::MutexLock lock(&mutex_);
  v1::Heartbeat heartbeat;
  units_.AddTo(&heartbeat);
  for (v1::LogEvent& line : log_.tail->Take()) *heartbeat.add_log() = std::move(line);
  return heartbeat;
}

void LeaseRunner::Leave(const std::string& reason) {
  absl::MutexLock lock(&mutex_);
  leave_.finishes_units = false;
  BeginToLeave(reason);
}

bool LeaseRunner::FinishesUnits() const {
  absl::MutexLock lock(&mutex_);
  return leave_.finishes_units;
}

void LeaseRunner::OnDrain(const v1::Drain& drain) {
  if (!leave_.leaving) leave_.finishes_units = drain.finish_units();
  BeginToLeave("drained");
}

void LeaseRunner::Rest(const std::string& reason) {
  absl::MutexLock lock(&mutex_);
  if (reason == rest_ || outbox_ == nullptr) return;
  rest_ = reason;
  log_.log->info("event={} reason={} leases={}", reason.empty() ? "working" : "resting",
                 logging::Quoted(reason), units_.held().size());
  v1::WorkerMessage message;
  message.mutable_rest()->set_reason(reason);
  outbox_->Send(std::move(message));
  if (!reason.empty()) HandBackWaiting();
}

void LeaseRunner::BeginToLeave(const std::string& reason) {
  if (leave_.leaving) return;
  leave_.leaving = true;
  log_.log->info("event=leaving reason={} leases={}", reason, units_.held().size());
  v1::WorkerMessage message;
  message.mutable_leaving()->set_reason(reason);
  if (outbox_ != nullptr) outbox_->Send(std::move(message));
  HandBackWaiting();
}

bool LeaseRunner::IsLeaving() const {
  absl::MutexLock lock(&mutex_);
  return leave_.leaving;
}

void LeaseRunner::OnMove(const v1::Move& move) {
  const bool is_new = !leave_.move.has_value() || (move.at_once() && !leave_.move->at_once());
  if (leave_.leaving || !is_new) return;
  log_.log->info("event=moving address={} at_once={} leases={}", logging::Quoted(move.address()),
                 move.at_once(), units_.held().size());
  leave_.move = move;
  HandBackWaiting();
}

bool LeaseRunner::IsMoving() const {
  absl::MutexLock lock(&mutex_);
  return leave_.move.has_value();
}

std::optional<std::string> LeaseRunner::TakeMove() {
  absl::MutexLock lock(&mutex_);
  if (!leave_.move.has_value()) return std::nullopt;
  return std::exchange(leave_.move, std::nullopt)->address();
}

void LeaseRunner::HandBackUnfinished() {
  absl::MutexLock lock(&mutex_);
  HandBack([this](const v1::Lease& lease)
               ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !units_.IsDelivered(lease); });
}

bool LeaseRunner::HasLeft() const {
  absl::MutexLock lock(&mutex_);
  if (leave_.leaving) return leave_.released && units_.held().empty();
  return leave_.move.has_value() && (leave_.move->at_once() || units_.held().empty());
}

absl::Time LeaseRunner::IdleSince() const {
  absl::MutexLock lock(&mutex_);
  return units_.IdleSince();
}

void LeaseRunner::RunThread() {
  while (true) {
    TakenPtr taken;
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &LeaseRunner::HasWorkOrStops));
      if (stopping_) return;
      taken = units_.TakeWaiting();
    }
    const absl::Time start = rpc::MonotonicNow();
    activities_.Change(Activity::kWaiting, Activity::kRendering, start);
    Work(taken);
    const absl::Time end = rpc::MonotonicNow();
    activities_.Change(Activity::kRendering, Activity::kWaiting, end);
    account_.Add(taken->lease.unit().job_id(), end - start);
  }
}

void LeaseRunner::Work(const TakenPtr& taken) {
  absl::Status status = Try(taken);
  if (scene::IsOutOfMemory(status) && !taken->is_delivered) {
    log_.log->warn(
        "event=memory_short {} meaning=\"scenes that are not in use are unloaded, and it is tried again\"",
        Describe(taken->lease.unit()));
    renderer_->DropIdle();
    status = Try(taken);
  }
  if (scene::IsOutOfMemory(status)) HandBackJob(taken->lease.unit().job_id());
  if (!status.ok()) Fail(taken, status);
}

absl::Status LeaseRunner::Try(const TakenPtr& taken) {
  try {
    return TryUnguarded(taken);
  } catch (const std::bad_alloc&) {
    return scene::OutOfMemory("the unit");
  }
}

absl::Status LeaseRunner::TryUnguarded(const TakenPtr& taken) {
  const v1::UnitId& unit = taken->lease.unit();
  const absl::StatusOr<std::shared_ptr<const v1::JobSpec>> spec = specs_->Get(unit.job_id(), unit.kind());
  if (absl::IsNotFound(spec.status())) {
    EndJobOf(taken);
    return absl::OkStatus();
  }
  if (!spec.ok()) return spec.status();
  if (unit.kind() == v1::UNIT_KIND_RESULT || unit.kind() == v1::UNIT_KIND_BLOCK ||
      unit.kind() == v1::UNIT_KIND_ESTIMATE)
    return Finish(taken, **spec);
  const absl::StatusOr<RenderedUnit> rendered = renderer_->Render(**spec, taken->lease, &taken->control);
  return rendered.ok() ? Deliver(taken, **spec, *rendered) : rendered.status();
}

absl::Status LeaseRunner::Finish(const TakenPtr& taken, const v1::JobSpec& spec) {
  if (frames_.link == nullptr) return absl::UnimplementedError("this worker finishes no frames");
  const v1::Lease& lease = taken->lease;
  absl::StatusOr<rpc::FileHandle> kept = rpc::FileHandle();
  if (lease.keep()) {
    absl::MutexLock lock(&mutex_);
    kept = units_.kept().Open(lease.unit());
    if (!kept.ok()) return kept.status();
  }
  const absl::Status finished = FinishFrame(spec, lease, *std::move(kept), frames_, &taken->control);
  if (!finished.ok()) return finished;
  absl::MutexLock lock(&mutex_);
  if (lease.keep() && units_.IsHeld(taken)) units_.kept().Drop(lease.unit());
  log_.log->info("event=frame_finished {}", Describe(lease.unit()));
  ++totals_.frames_finished;
  units_.RemoveHeld([&](const v1::Lease& held) { return IsLease(held, lease.unit(), lease.attempt()); });
  return absl::OkStatus();
}

void LeaseRunner::HandBackJob(const std::string& job_id) {
  absl::MutexLock lock(&mutex_);
  HandBack([&](const v1::Lease& lease) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return lease.unit().job_id() == job_id && !units_.IsTaken(lease);
  });
}

void LeaseRunner::Fail(const TakenPtr& taken, const absl::Status& failure) {
  absl::MutexLock lock(&mutex_);
  if (!units_.IsHeld(taken)) return;
  const v1::Lease& lease = taken->lease;
  ++totals_.failures[ReasonOf(failure)];
  log_.log->error("event=unit_failed {} error={}", Describe(lease.unit()),
                  logging::Quoted(failure.message()));
  // In this order: a heartbeat in between must not make the coordinator think that the lease was dropped.
  SendFailure(lease, failure, log_.tail->Take(), outbox_.get());
  units_.RemoveHeld([&](const v1::Lease& held) { return IsLease(held, lease.unit(), lease.attempt()); });
}

void LeaseRunner::EndJobOf(const TakenPtr& taken) {
  absl::MutexLock lock(&mutex_);
  if (units_.IsHeld(taken)) OnJobEnded(taken->lease.unit().job_id());
}

absl::Status LeaseRunner::Deliver(const TakenPtr& taken, const v1::JobSpec& spec, const RenderedUnit& unit) {
  {
    absl::MutexLock lock(&mutex_);
    log_.log->debug("event=unit_rendered {} seconds={:.3f}", Describe(taken->lease.unit()),
                    unit.stats.seconds());
    ++totals_.units_rendered;
    totals_.samples += unit.stats.samples();
    totals_.rays += unit.stats.rays();
  }
  if (taken->lease.keep()) return Keep(taken, spec, unit);
  Send(taken, unit);
  return absl::OkStatus();
}

absl::Status LeaseRunner::Keep(const TakenPtr& taken, const v1::JobSpec& spec, const RenderedUnit& unit) {
  const v1::Lease& lease = taken->lease;
  const absl::StatusOr<film::EncodedUnit> record = RecordOf(spec, lease, unit);
  if (!record.ok()) return record.status();
  v1::WorkerMessage message;
  v1::KeptUnit* const kept = message.mutable_kept();
  *kept->mutable_unit() = lease.unit();
  kept->set_attempt(lease.attempt());
  *kept->mutable_stats() = record->stats;
  kept->mutable_stats()->clear_camera();
  kept->mutable_stats()->clear_objects();
  kept->set_record_bytes(record->size_bytes());
  absl::MutexLock lock(&mutex_);
  if (!units_.IsHeld(taken)) return absl::OkStatus();
  if (absl::Status status = units_.kept().Add(*record); !status.ok()) return status;
  taken->is_delivered = true;
  totals_.unit_bytes_sent += static_cast<int64_t>(message.ByteSizeLong());
  outbox_->Send(std::move(message));
  return absl::OkStatus();
}

void LeaseRunner::Send(const TakenPtr& taken, const RenderedUnit& unit) {
  std::shared_ptr<Outbox> outbox;
  {
    absl::MutexLock lock(&mutex_);
    if (!units_.IsHeld(taken)) return;
    taken->is_delivered = true;
    outbox = outbox_;
  }
  int64_t bytes = 0;
  activities_.Change(Activity::kRendering, Activity::kSending, rpc::MonotonicNow());
  SendUnit(taken->lease, unit, [&](v1::WorkerMessage message) {
    bytes += static_cast<int64_t>(message.ByteSizeLong());
    outbox->Send(std::move(message));
  });
  activities_.Change(Activity::kSending, Activity::kRendering, rpc::MonotonicNow());
  absl::MutexLock lock(&mutex_);
  totals_.unit_bytes_sent += bytes;
}

monitoring::WorkerMetrics LeaseRunner::Metrics() const {
  const ThreadActivities::Times spent = activities_.Spent(rpc::MonotonicNow());
  absl::MutexLock lock(&mutex_);
  monitoring::WorkerMetrics metrics = totals_;
  units_.AddTo(&metrics);
  for (const auto& [activity, name] : {std::pair{Activity::kWaiting, "waiting"},
                                       {Activity::kRendering, "rendering"},
                                       {Activity::kSending, "sending"}})
    metrics.seconds[name] = absl::ToDoubleSeconds(spent[static_cast<size_t>(activity)]);
  return metrics;
}

}  // namespace lumifold::worker
