// What workers tell the coordinator, and the leases it grants them.
#include <spdlog/logger.h>

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/version.h"
#include "server/access/identity.h"
#include "server/coordinator/coordinator.h"

namespace lumifold::server {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

namespace {

constexpr int kMaxSlots = 1024;
constexpr int kMaxLeasesPerGrant = 256;
/// Ids of jobs are shorter, see job::MakeJobId; those in a worker's Hello are kept.
constexpr size_t kMaxJobIdBytes = 64;

v1::Lease ProtoFromLease(const scheduler::GrantedLease& lease) {
  v1::Lease proto;
  *proto.mutable_unit() = ProtoFromUnit(lease.unit);
  proto.set_attempt(lease.attempt.value());
  proto.mutable_rect()->set_x0(lease.rect.x0);
  proto.mutable_rect()->set_y0(lease.rect.y0);
  proto.mutable_rect()->set_x1(lease.rect.x1);
  proto.mutable_rect()->set_y1(lease.rect.y1);
  if (lease.samples.IsUniform()) {
    proto.set_first_sample(static_cast<int32_t>(lease.samples.blocks()[0].first));
    proto.set_last_sample(static_cast<int32_t>(lease.samples.blocks()[0].last));
    return proto;
  }
  for (const SampleRange& block : lease.samples.blocks()) {
    proto.add_block_samples(block.first);
    proto.add_block_samples(block.last);
  }
  return proto;
}

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
  if (hello.numeric_class().empty() || hello.slots() < 1 || hello.slots() > kMaxSlots) {
    return absl::InvalidArgumentError(absl::StrCat(
        "worker '", hello.name(), "': numeric_class must not be empty and slots must be 1 to ", kMaxSlots));
  }
  const auto is_tag = [](const std::string& tag) { return !tag.empty() && tag.size() <= rpc::kMaxTagBytes; };
  if (hello.tags_size() > static_cast<int>(rpc::kMaxTags) ||
      !std::all_of(hello.tags().begin(), hello.tags().end(), is_tag)) {
    return absl::InvalidArgumentError(absl::StrCat("worker '", hello.name(), "': more than ", rpc::kMaxTags,
                                                   " tags, or one that has not 1 to ", rpc::kMaxTagBytes,
                                                   " bytes"));
  }
  const auto is_unit = [](const v1::Lease& lease) {
    return !lease.unit().job_id().empty() && lease.unit().job_id().size() <= kMaxJobIdBytes;
  };
  if (hello.in_hand_size() > hello.slots() ||
      !std::all_of(hello.in_hand().begin(), hello.in_hand().end(), is_unit)) {
    return absl::InvalidArgumentError(absl::StrCat("worker '", hello.name(),
                                                   "': more units in hand than its ", hello.slots(),
                                                   " slots, or one without the id of a job"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<WorkerId> Coordinator::AddWorker(const v1::Hello& hello, const access::Identity& caller,
                                                WorkerSink* sink) {
  if (absl::Status status = CheckHello(hello); !status.ok()) {
    options_.log->warn("event=worker_refused worker={} error={}", logging::Quoted(hello.name()),
                       logging::Quoted(std::string(status.message())));
    return status;
  }
  absl::MutexLock lock(&mutex_);
  if (stopping_) return absl::UnavailableError("the coordinator is stopping");
  const WorkerId worker(next_worker_++);
  const std::string process = logging::OneWord(hello.name());
  // What a worker says of itself must not free it from a block.
  const std::string name =
      caller.kind == access::IdentityKind::kLocal ? process : logging::OneWord(caller.name);
  scheduler_.AddWorker(worker, {.name = name,
                                .numeric_class = hello.numeric_class(),
                                .instance = hello.instance(),
                                .slots = hello.slots(),
                                .tags = {hello.tags().begin(), hello.tags().end()}});
  workers_.emplace(worker, ConnectedWorker{.name = name,
                                           .process = process,
                                           .caller = access::KeyOf(caller),
                                           .slots = hello.slots(),
                                           .sink = sink,
                                           .connected = options_.wall_now(),
                                           .known_jobs = {}});
  v1::CoordinatorMessage welcome;
  welcome.mutable_welcome()->set_worker_id(job::TextOf(worker));
  welcome.mutable_welcome()->set_heartbeat_ms(absl::ToInt64Milliseconds(options_.heartbeat));
  sink->Send(welcome);
  options_.log->info("event=worker_connected worker={} process={} class={} slots={}", NameOf(worker), process,
                     logging::Quoted(hello.numeric_class()), hello.slots());
  NoteInHand(worker, hello);
  GrantInHand();
  GrantLeases();
  return worker;
}

void Coordinator::RemoveWorker(WorkerId worker) {
  absl::MutexLock lock(&mutex_);
  options_.log->info("event=worker_gone worker={}", NameOf(worker));
  workers_.erase(worker);
  ForgetInHand([&](const UnitInHand& unit) { return unit.worker == worker; });
  const std::vector<scheduler::FailedJob> failed = scheduler_.RemoveWorker(worker);
  if (!leasing_) return;
  for (const scheduler::FailedJob& job : failed) EndJob(job.job, v1::JOB_STATE_FAILED, job.error);
  for (const auto& [job, record] : active_jobs_) changed_jobs_.insert(job);
  GrantLeases();
}

void Coordinator::OnHeartbeat(WorkerId worker, const v1::Heartbeat& heartbeat) {
  std::vector<scheduler::HeldLease> held;
  for (const v1::Lease& lease : heartbeat.held()) {
    held.push_back({job::UnitFromProto(lease.unit()), Attempt(lease.attempt()), lease.progress()});
  }
  absl::MutexLock lock(&mutex_);
  ReportLate(scheduler_.Heartbeat(worker, held, Attempt(heartbeat.newest_attempt()), options_.now()));
  GrantLeases();
}

std::optional<LeasedUnit> Coordinator::FindLease(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  absl::MutexLock lock(&mutex_);
  if (!scheduler_.HoldsLease(worker, unit, attempt)) return std::nullopt;
  return LeasedUnit{scheduler_.UnitsOf(unit.job).tiles().RectOf(unit.key.tile), scheduler_.SamplesOf(unit),
                    film::ModelOf(scheduler_.SpecOf(unit.job))};
}

void Coordinator::Deliver(WorkerId worker, film::EncodedUnit unit) {
  traffic_.units_received += static_cast<int64_t>(unit.size_bytes());
  absl::MutexLock lock(&mutex_);
  const scheduler::Completion completion =
      scheduler_.CompleteUnit(worker, unit.unit, unit.attempt, options_.now(), unit.digest);
  if (completion == scheduler::Completion::kAudited) {
    options_.log->debug("event=unit_audited unit={} worker={}", logging::Quoted(Describe(unit.unit)),
                        NameOf(worker));
    Acknowledge(worker, unit.unit, unit.attempt);
    return GrantLeases();
  }
  if (completion != scheduler::Completion::kAccepted) {
    options_.log->info("event=unit_not_wanted unit={} worker={}", logging::Quoted(Describe(unit.unit)),
                       NameOf(worker));
    Acknowledge(worker, unit.unit, unit.attempt);
    return;
  }
  const JobId job = unit.unit.job;
  const Rect rect = scheduler_.UnitsOf(job).tiles().RectOf(unit.unit.key.tile);
  const int64_t samples = scheduler_.SamplesOf(unit.unit).CountIn(rect.width(), rect.height());
  committer_->Enqueue({.stored = std::move(unit),
                       .worker = worker,
                       .worker_name = workers_.at(worker).name,
                       .samples = samples,
                       .numeric_class = scheduler_.NumericClassOf(job),
                       .started = active_jobs_.at(job).started});
}

void Coordinator::Dismiss(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  absl::MutexLock lock(&mutex_);
  options_.log->info("event=unit_not_wanted unit={} worker={}", logging::Quoted(Describe(unit)),
                     NameOf(worker));
  Acknowledge(worker, unit, attempt);
}

void Coordinator::RefuseUnit(WorkerId worker, const UnitRef& unit, Attempt attempt,
                             const std::string& reason) {
  std::string error;
  {
    absl::MutexLock lock(&mutex_);
    error = absl::StrCat("worker ", NameOf(worker), " delivered ", Describe(unit),
                         ", which is not valid: ", reason);
    Acknowledge(worker, unit, attempt, reason);
  }
  FailUnit(worker, unit, attempt, error, /*permanent=*/false);
}

void Coordinator::FailUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, const std::string& error,
                           bool permanent) {
  absl::MutexLock lock(&mutex_);
  const scheduler::FailureOutcome outcome =
      scheduler_.FailUnit(worker, unit, attempt, permanent, options_.now());
  options_.log->warn("event=unit_failed unit={} worker={} permanent={} error={}",
                     logging::Quoted(Describe(unit)), NameOf(worker), permanent, logging::Quoted(error));
  if (outcome == scheduler::FailureOutcome::kJobFails) EndJob(unit.job, v1::JOB_STATE_FAILED, error);
  GrantLeases();
}

void Coordinator::HandBack(WorkerId worker, const v1::HandBack& message) {
  absl::MutexLock lock(&mutex_);
  int returned = 0;
  for (const v1::Lease& lease : message.leases())
    returned += scheduler_.HandBack(worker, job::UnitFromProto(lease.unit()), Attempt(lease.attempt()));
  options_.log->info("event=leases_handed_back worker={} leases={}", NameOf(worker), returned);
  GrantLeases();
}

void Coordinator::OnLeaving(WorkerId worker, const std::string& reason) {
  absl::MutexLock lock(&mutex_);
  options_.log->info("event=worker_leaving worker={} reason={}", NameOf(worker), logging::Quoted(reason));
  scheduler_.DrainWorker(worker);
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return;
  v1::CoordinatorMessage message;
  message.mutable_released();
  found->second.sink->Send(message);  // after all grants, which are sent under the same lock
}

void Coordinator::GrantLeases() {
  if (!leasing_) return;
  FollowAudits();
  for (const scheduler::SetAsideWorker& aside : scheduler_.TakeSetAside()) {
    options_.log->warn("event=worker_set_aside worker={} seconds={:.0f} reason={}", NameOf(aside.worker),
                       absl::ToDoubleSeconds(aside.until - options_.now()), logging::Quoted(aside.reason));
  }
  SendVoided();
  if (storage_.ok()) SendGrants(scheduler_.GrantLeases(options_.now()));
}

void Coordinator::SendGrants(const std::vector<scheduler::GrantedLease>& leases) {
  v1::CoordinatorMessage message;
  WorkerId to;
  JobId granting;
  const auto send = [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (message.grant().leases_size() > 0) workers_.at(to).sink->Send(message);
    message.Clear();
  };
  for (const scheduler::GrantedLease& lease : leases) {
    const JobId& job = lease.unit.job;
    if (lease.worker != to || job != granting || message.grant().leases_size() >= kMaxLeasesPerGrant) send();
    to = lease.worker;
    granting = job;
    if (lease.alone) {
      options_.log->warn("event=unit_in_quarantine unit={} worker={}", logging::Quoted(Describe(lease.unit)),
                         NameOf(lease.worker));
    }
    workers_.at(to).known_jobs.insert(job);
    *message.mutable_grant()->add_leases() = ProtoFromLease(lease);
    ledger::JobRecord& record = active_jobs_.at(job);
    message.mutable_grant()->set_trace_id(record.scheduling.trace_id());
    options_.log->debug("event=lease_granted unit={} worker={} attempt={}",
                        logging::Quoted(Describe(lease.unit)), NameOf(lease.worker), lease.attempt.value());
    if (record.started == absl::InfinitePast()) record.started = options_.wall_now();
    render_starts_.try_emplace(job, options_.now() - absl::Seconds(record.times.render_seconds()));
    changed_jobs_.insert(job);
    housekeeping_.Notify();
  }
  send();
}

void Coordinator::SendVoided() {
  std::map<WorkerId, v1::CoordinatorMessage> messages;
  for (const scheduler::VoidedLease& lease : scheduler_.TakeVoided()) {
    if (!active_jobs_.contains(lease.unit.job)) continue;  // JobEnded says so
    v1::Lease* proto = messages[lease.worker].mutable_void_leases()->add_leases();
    *proto->mutable_unit() = ProtoFromUnit(lease.unit);
    proto->set_attempt(lease.attempt.value());
  }
  for (const auto& [worker, message] : messages) {
    const auto found = workers_.find(worker);
    if (found == workers_.end()) continue;
    options_.log->info("event=leases_void worker={} leases={}", NameOf(worker),
                       message.void_leases().leases_size());
    found->second.sink->Send(message);
  }
}

void Coordinator::Acknowledge(WorkerId worker, const UnitRef& unit, Attempt attempt,
                              const std::string& refused) {
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return;
  v1::CoordinatorMessage message;
  *message.mutable_ack()->mutable_unit() = ProtoFromUnit(unit);
  message.mutable_ack()->set_attempt(attempt.value());
  message.mutable_ack()->set_refused(refused);
  found->second.sink->Send(message);
}

}  // namespace lumifold::server
