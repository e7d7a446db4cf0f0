#include "server/coordinator/worker_calls.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/version.h"
#include "server/access/identity.h"
#include "server/coordinator/event_log.h"
#include "server/coordinator/farm_keeping.h"

namespace lumifold::server {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

namespace {

constexpr int kMaxSlots = 1024;
/// Frames that a worker may offer to finish at a time.
constexpr int kMaxFinishes = 1024;

absl::Status CheckHello(const v1::Hello& hello) {
  if (hello.name().size() > rpc::kMaxWorkerNameBytes ||
      hello.numeric_class().size() > rpc::kMaxWorkerNameBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("worker: its name has ", hello.name().size(), " bytes and its numeric_class ",
                     hello.numeric_class().size(), ", allowed are ", rpc::kMaxWorkerNameBytes));
  }
  if (hello.wire_version() != rpc::kWireVersion) {
    return absl::FailedPreconditionError(absl::StrCat("worker '", hello.name(), "' has wire version ",
                                                      hello.wire_version(), ", this coordinator ",
                                                      rpc::kWireVersion));
  }
  const int least_slots = hello.finishes() > 0 ? 0 : 1;
  if (hello.numeric_class().empty() || hello.slots() < least_slots || hello.slots() > kMaxSlots) {
    return absl::InvalidArgumentError(absl::StrCat("worker '", hello.name(),
                                                   "': numeric_class must not be empty and slots must be ",
                                                   least_slots, " to ", kMaxSlots));
  }
  const auto is_tag = [](const std::string& tag) { return !tag.empty() && tag.size() <= rpc::kMaxTagBytes; };
  if (hello.tags_size() > static_cast<int>(rpc::kMaxTags) ||
      !std::all_of(hello.tags().begin(), hello.tags().end(), is_tag)) {
    return absl::InvalidArgumentError(absl::StrCat("worker '", hello.name(), "': more than ", rpc::kMaxTags,
                                                   " tags, or one that has not 1 to ", rpc::kMaxTagBytes,
                                                   " bytes"));
  }
  return absl::OkStatus();
}

/// One frame more than it finishes at a time: that is being rendered meanwhile.
scheduler::KeepOffer KeepOfferOf(const v1::Hello& hello) {
  if (hello.finishes() <= 0) return {};
  return {.frames = std::min(hello.finishes(), kMaxFinishes) + 1,
          .record_bytes = hello.keep_bytes(),
          .finish_bytes = hello.finish_memory_bytes()};
}

}  // namespace

absl::StatusOr<WorkerId> WorkerCalls::AddWorker(const v1::Hello& hello, const access::Identity& caller,
                                                WorkerSink* sink) {
  if (absl::Status status = CheckHello(hello); !status.ok()) {
    resources_->log().warn("event=worker_refused worker={} error={}", logging::Quoted(hello.name()),
                           logging::Quoted(status.message()));
    return status;
  }
  FarmState::Change farm(state_);
  if (farm->is_stopping()) return absl::UnavailableError("the coordinator is stopping");
  const std::string process = logging::OneWord(hello.name());
  // What a worker says of itself must not free it from a block.
  const bool is_certified = caller.kind != access::IdentityKind::kLocal;
  const std::string name = is_certified ? logging::OneWord(caller.name) : process;
  const WorkerId worker = farm->workers.Add({.name = name,
                                             .process = process,
                                             .caller = access::KeyOf(caller),
                                             .slots = hello.slots(),
                                             .sink = sink,
                                             .connected = resources_->options.wall_now(),
                                             .known_jobs = {}});
  farm->scheduler.workers().Add(worker, {.name = name,
                                         .party = PartyOf(name, is_certified),
                                         .numeric_class = hello.numeric_class(),
                                         .instance = hello.instance(),
                                         .slots = hello.slots(),
                                         .memory_bytes = hello.memory_bytes(),
                                         .tags = {hello.tags().begin(), hello.tags().end()},
                                         .keep = KeepOfferOf(hello)});
  farm->finish_leases.AddWorker(worker, {.party = PartyOf(name, is_certified),
                                         .numeric_class = hello.numeric_class(),
                                         .places = std::min(hello.finishes(), kMaxFinishes),
                                         .memory_bytes = hello.finish_memory_bytes()});
  if (hello.finishes() > 0) farm->frames.Wake();
  v1::CoordinatorMessage welcome;
  welcome.mutable_welcome()->set_worker_id(job::TextOf(worker));
  welcome.mutable_welcome()->set_heartbeat_ms(
      absl::ToInt64Milliseconds(resources_->options.workers.heartbeat));
  sink->Send(welcome);
  resources_->log().info("event=worker_connected worker={} process={} class={} slots={}",
                         farm->workers.NameOf(worker), process, logging::Quoted(hello.numeric_class()),
                         hello.slots());
  return worker;
}

void WorkerCalls::RemoveWorker(WorkerId worker) {
  FarmState::Change farm(state_);
  resources_->log().info("event=worker_gone worker={}", farm->workers.NameOf(worker));
  farm->TakeFramesBack(farm->finish_leases.RemoveWorker(worker), "worker_gone", Farm::Return::kFailed);
  farm->workers.Remove(worker);
  farm->scheduler.workers().Remove(worker);
  if (!farm->is_leasing()) return;
  for (const auto& [job, active] : farm->jobs.active()) farm->watchers.MarkChanged(job);
}

void WorkerCalls::OnHeartbeat(WorkerId worker, const v1::Heartbeat& heartbeat) {
  std::vector<scheduler::HeldLease> held;
  for (const v1::Lease& lease : heartbeat.held()) {
    held.push_back({job::UnitFromProto(lease.unit()), Attempt(lease.attempt()), lease.progress()});
  }
  FarmState::Change farm(state_);
  const Attempt newest(heartbeat.newest_attempt());
  const absl::Time now = resources_->options.now();
  farm->ReportLate(farm->scheduler.workers().Heartbeat(worker, held, newest, now));
  farm->TakeFramesBack(farm->finish_leases.Heartbeat(worker, held, newest, now), "dropped",
                       Farm::Return::kFailed);
  for (const v1::Lease& lease : heartbeat.held()) {
    const FramePart part = PartOf(job::UnitFromProto(lease.unit()));
    const bool is_leased = farm->finish_leases.Find(worker, part, Attempt(lease.attempt())) != nullptr;
    if (is_leased && farm->frames.SetFiltered(part, lease.filtered()))
      farm->watchers.MarkChanged(part.frame.first);
  }
}

void WorkerCalls::KeepLog(WorkerId worker, const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines) {
  if (lines.empty() || resources_->options.job_log.events == nullptr) return;
  FarmState::View farm(state_);
  const ConnectedWorker* const found = farm->workers.Find(worker);
  if (found == nullptr) return;
  resources_->options.job_log.events->AddOfWorker(
      farm->workers.NameOf(worker), lines, resources_->options.wall_now(),
      [&](const std::string& job) { return found->known_jobs.contains(JobId(job)); });
}

std::optional<LeasedUnit> WorkerCalls::FindLease(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  FarmState::View farm(state_);
  const scheduler::Scheduler& scheduler = farm->scheduler;
  if (!scheduler.units().HoldsLease(worker, unit, attempt)) return std::nullopt;
  return LeasedUnit{scheduler.jobs().UnitsOf(unit.job).tiles().RectOf(unit.key.tile),
                    scheduler.units().SamplesOf(unit), film::ModelOf(scheduler.jobs().SpecOf(unit.job))};
}

void WorkerCalls::Deliver(WorkerId worker, film::EncodedUnit unit) {
  resources_->traffic.units_received += static_cast<int64_t>(unit.size_bytes());
  FarmState::Change farm(state_);
  const scheduler::Completion completion = farm->scheduler.units().Complete(
      worker, unit.unit, unit.attempt, resources_->options.now(), unit.digest,
      {.rendering = absl::Seconds(unit.stats.seconds()), .bytes = unit.size_bytes()});
  if (completion == scheduler::Completion::kAudited) {
    resources_->log().debug("event=unit_audited unit={} worker={}", logging::Quoted(Describe(unit.unit)),
                            farm->workers.NameOf(worker));
    return farm->workers.Acknowledge(worker, unit.unit, unit.attempt);
  }
  if (completion != scheduler::Completion::kAccepted) {
    resources_->log().info("event=unit_not_wanted unit={} worker={}", logging::Quoted(Describe(unit.unit)),
                           farm->workers.NameOf(worker));
    return farm->workers.Acknowledge(worker, unit.unit, unit.attempt);
  }
  const JobId job = unit.unit.job;
  const Rect rect = farm->scheduler.jobs().UnitsOf(job).tiles().RectOf(unit.unit.key.tile);
  const int64_t samples = farm->scheduler.units().SamplesOf(unit.unit).CountIn(rect.width(), rect.height());
  committer_->Enqueue({.stored = std::move(unit),
                       .worker = worker,
                       .worker_name = farm->workers.Find(worker)->name,
                       .samples = samples,
                       .numeric_class = farm->scheduler.jobs().NumericClassOf(job),
                       .started = farm->jobs.FindActive(job)->record.started,
                       .accepted = resources_->options.wall_now()});
}

void WorkerCalls::Keep(WorkerId worker, const KeptUnit& kept) {
  const job::UnitRef& unit = kept.unit;
  bool is_asked_for = true;
  {
    FarmState::Change farm(state_);
    const std::optional<WorkerId> keeper = farm->scheduler.keeping().KeeperOf(unit.job, unit.key.frame);
    is_asked_for = keeper == worker || !farm->scheduler.units().HoldsLease(worker, unit, kept.attempt);
    if (is_asked_for) {
      const scheduler::Completion completion =
          farm->scheduler.units().Complete(worker, unit, kept.attempt, resources_->options.now(), "",
                                           {.rendering = absl::Seconds(kept.stats.seconds()), .bytes = 0});
      if (completion == scheduler::Completion::kAccepted) {
        CountKept(*resources_, worker, kept, &*farm);
      } else {
        resources_->log().info("event=unit_not_wanted unit={} worker={}", logging::Quoted(Describe(unit)),
                               farm->workers.NameOf(worker));
      }
      farm->workers.Acknowledge(worker, unit, kept.attempt);
    }
  }
  if (!is_asked_for) RefuseUnit(worker, unit, kept.attempt, "its record is to be delivered");
}

void WorkerCalls::Dismiss(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  FarmState::View farm(state_);
  resources_->log().info("event=unit_not_wanted unit={} worker={}", logging::Quoted(Describe(unit)),
                         farm->workers.NameOf(worker));
  farm->workers.Acknowledge(worker, unit, attempt);
}

void WorkerCalls::RefuseUnit(WorkerId worker, const UnitRef& unit, Attempt attempt,
                             const std::string& reason) {
  std::string error;
  {
    FarmState::View farm(state_);
    error = absl::StrCat("worker ", farm->workers.NameOf(worker), " delivered ", Describe(unit),
                         ", which is not valid: ", reason);
    farm->workers.Acknowledge(worker, unit, attempt, reason);
  }
  FailUnit(worker, unit, attempt, {.error = error});
}

void WorkerCalls::FailUnit(WorkerId worker, const UnitRef& unit, Attempt attempt,
                           const scheduler::UnitFailure& failure) {
  if (IsOfFinishing(unit.key.kind))
    return finishing_.TakeBack(worker, unit, attempt, failure.error, Farm::Return::kFailed);
  FarmState::Change farm(state_);
  const bool has_failed =
      farm->scheduler.units().Fail(worker, unit, attempt, failure, resources_->options.now());
  if (const ConnectedWorker* const found = farm->workers.Find(worker); has_failed && found != nullptr)
    farm->history.AddFailure(found->name, unit.job, unit.key.frame, resources_->options.wall_now());
  resources_->log().warn("event=unit_failed unit={} worker={} permanent={} out_of_memory={} error={}",
                         logging::Quoted(Describe(unit)), farm->workers.NameOf(worker), failure.permanent,
                         failure.out_of_memory, logging::Quoted(failure.error));
}

void WorkerCalls::HandBack(WorkerId worker, const v1::HandBack& message) {
  for (const v1::Lease& lease : message.leases()) {
    if (IsOfFinishing(lease.unit().kind()))
      finishing_.TakeBack(worker, job::UnitFromProto(lease.unit()), Attempt(lease.attempt()), "handed_back",
                          Farm::Return::kHandedBack);
  }
  FarmState::Change farm(state_);
  int returned = 0;
  for (const v1::Lease& lease : message.leases())
    returned +=
        farm->scheduler.units().HandBack(worker, job::UnitFromProto(lease.unit()), Attempt(lease.attempt()));
  resources_->log().info("event=leases_handed_back worker={} leases={}", farm->workers.NameOf(worker),
                         returned);
}

void WorkerCalls::OnLeaving(WorkerId worker, const std::string& reason) {
  FarmState::Change farm(state_);
  resources_->log().info("event=worker_leaving worker={} reason={}", farm->workers.NameOf(worker),
                         logging::Quoted(reason));
  farm->scheduler.workers().Drain(worker);
  v1::CoordinatorMessage message;
  message.mutable_released();
  farm->workers.Send(worker, message);  // after all grants, which are sent under the same lock
}

void WorkerCalls::OnRest(WorkerId worker, const std::string& reason) {
  FarmState::Change farm(state_);
  resources_->log().info("event=worker_{} worker={} reason={}", reason.empty() ? "works" : "rests",
                         farm->workers.NameOf(worker), logging::Quoted(reason));
  farm->scheduler.workers().Rest(worker, reason);
  farm->frames.Wake();  // it may finish frames again
}

void WorkerCalls::OnAssetMissing(WorkerId worker, const UnitRef& unit, Attempt attempt,
                                 const std::string& sha256, const std::string& error) {
  scene_files_.OnMissing(worker, unit, attempt, sha256, [this, worker, unit, attempt, error] {
    FailUnit(worker, unit, attempt, {.error = error});
  });
}

}  // namespace lumifold::server
