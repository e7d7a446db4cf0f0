#include "server/coordinator/operator_calls.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <deque>
#include <limits>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "server/coordinator/list_limit.h"
#include "server/job/scheduling.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;
using job::WorkerId;

namespace {

/// Prefix of page tokens after the connected workers; the name of a blocked worker follows.
constexpr char kBlockedToken[] = "b-";

/// The connected workers that a request means, and the name that they have in common.
struct NamedWorkers {
  std::string name;
  std::vector<WorkerId> connected;
};

v1::WorkerStatus StatusOf(const Farm& farm, const scheduler::WorkerInfo& info) {
  const ConnectedWorker& worker = *farm.workers.Find(info.worker);
  v1::WorkerStatus status;
  status.set_worker_id(TextOf(info.worker));
  status.set_name(info.traits.name);
  status.set_process(worker.process);
  status.set_state(info.state);
  status.set_reason(info.reason);
  status.set_numeric_class(info.traits.numeric_class);
  for (const std::string& tag : info.traits.tags) status.add_tags(tag);
  status.set_slots(info.traits.slots);
  status.set_memory_bytes(info.traits.memory_bytes);
  status.set_leases(info.leases);
  status.set_units_done(info.units_done);
  status.set_units_failed(info.units_failed);
  status.set_seconds_per_unit(absl::ToDoubleSeconds(info.mean_time));
  status.set_connected_unix_ms(absl::ToUnixMillis(worker.connected));
  for (const JobId& job : info.jobs) status.add_job_ids(job.value());
  return status;
}

v1::WorkerStatus GoneWorker(const std::string& name, const std::string& reason) {
  v1::WorkerStatus status;
  status.set_name(name);
  status.set_state(v1::WORKER_STATE_GONE);
  status.set_reason(reason);
  return status;
}

/// The first connected worker of this name, or one that is not connected.
v1::WorkerStatus StatusOfName(const Farm& farm, const std::string& name, const std::string& reason) {
  const std::vector<WorkerId> connected = farm.scheduler.workers().Named(name);
  if (connected.empty()) return GoneWorker(name, reason);
  return StatusOf(farm, *farm.scheduler.workers().Describe(connected.front()));
}

std::string LogName(const Farm& farm, const std::string& name) {
  const std::vector<WorkerId> connected = farm.scheduler.workers().Named(name);
  return connected.empty() ? absl::StrCat("-/", name) : farm.workers.NameOf(connected.front());
}

absl::StatusOr<NamedWorkers> FindWorkers(const Farm& farm, const std::string& worker) {
  if (worker.empty() || worker.size() > rpc::kMaxWorkerNameBytes)
    return absl::InvalidArgumentError(
        absl::StrCat("worker has ", worker.size(), " bytes, not 1 to ", rpc::kMaxWorkerNameBytes));
  if (const std::optional<WorkerId> id = job::ParseWorkerId(worker)) {
    const std::optional<scheduler::WorkerInfo> info = farm.scheduler.workers().Describe(*id);
    if (!info.has_value()) return absl::NotFoundError(absl::StrCat("no worker ", worker, " is connected"));
    return NamedWorkers{info->traits.name, {*id}};
  }
  const std::string name = logging::OneWord(worker);
  return NamedWorkers{name, farm.scheduler.workers().Named(name)};
}

/// Adds the workers that a request means, with their history; one that is not connected if it has any.
void AddWithHistory(const Farm& farm, const NamedWorkers& named, v1::ListWorkersResponse* response) {
  for (const WorkerId worker : named.connected)
    *response->add_workers() = StatusOf(farm, *farm.scheduler.workers().Describe(worker));
  const std::deque<FrameOfWorker> frames = farm.history.Of(named.name);
  if (named.connected.empty()) {
    for (const scheduler::BlockedWorker& blocked : farm.scheduler.workers().Blocked()) {
      if (blocked.name == named.name) *response->add_workers() = GoneWorker(blocked.name, blocked.reason);
    }
    if (response->workers_size() == 0 && !frames.empty())
      *response->add_workers() = GoneWorker(named.name, "not connected");
  }
  if (response->workers_size() == 0) return;
  for (const FrameOfWorker& frame : frames) {
    v1::FrameOfWorker* const past = response->mutable_workers(0)->add_history();
    past->set_job_id(frame.job.value());
    past->set_frame(frame.frame);
    past->set_first_unix_ms(absl::ToUnixMillis(frame.first));
    past->set_last_unix_ms(absl::ToUnixMillis(frame.last));
    past->set_units(frame.units);
    past->set_seconds(absl::ToDoubleSeconds(frame.rendering));
    past->set_failed(frame.failed);
  }
}

/// Adds up to `limit` connected workers after this one: those that render `job`, all if it is empty.
void AddWorkers(const Farm& farm, WorkerId after, int limit, const std::string& job,
                v1::ListWorkersResponse* response) {
  while (true) {
    const std::vector<scheduler::WorkerInfo> some = farm.scheduler.workers().List(after, limit);
    for (const scheduler::WorkerInfo& info : some) {
      v1::WorkerStatus status = StatusOf(farm, info);
      const auto& jobs = status.job_ids();
      if (!job.empty() && std::find(jobs.begin(), jobs.end(), job) == jobs.end()) continue;
      *response->add_workers() = std::move(status);
      if (response->workers_size() == limit) return;
    }
    if (some.empty()) return;
    after = some.back().worker;
  }
}

}  // namespace

absl::StatusOr<v1::JobStatus> OperatorCalls::ChangeScheduling(
    const std::string& job_id, absl::FunctionRef<void(v1::Scheduling*)> change) {
  const JobId job(job_id);
  // Two changes of a job at the same time must not lose one of them. Held during the call of the ledger.
  absl::MutexLock one_change(&mutex_);
  std::optional<v1::Scheduling> scheduling;
  {
    FarmState::View farm(state_);
    if (const ActiveJob* const active = farm->jobs.FindActive(job); active != nullptr)
      scheduling = active->record.scheduling;
  }
  absl::Status recorded;
  if (scheduling.has_value()) {
    change(&*scheduling);
    recorded = resources_->store->SetScheduling(resources_->Owned(job), *scheduling);
    if (IsStorageError(recorded)) return resources_->NoteError(recorded);
    if (recorded.ok()) RecordScheduling(job, *scheduling);
  }
  {
    FarmState::Change farm(state_);
    ActiveJob* const active = farm->jobs.FindActive(job);
    if (scheduling.has_value() && recorded.ok() && active != nullptr) {
      Reschedule(&*farm, active, *scheduling);
      return *farm->StatusOf(job);
    }
  }
  const absl::StatusOr<v1::JobStatus> status = queries_->StatusOf(job);
  if (!status.ok()) return status;
  if (absl::Status ended = JobQueries::CheckHasEnded(*status); !ended.ok()) return ended;
  return absl::FailedPreconditionError(absl::StrCat("job ", job_id, " has ended"));
}

void OperatorCalls::RecordScheduling(const JobId& job, const v1::Scheduling& scheduling) {
  // By the committer, so that it cannot write the manifest of a job that ends meanwhile.
  committer_->Write(
      [this, job, scheduling] {
        const bool is_active = FarmState::View(state_)->jobs.FindActive(job) != nullptr;
        return is_active ? RewriteManifest(resources_->folder, job, scheduling) : absl::OkStatus();
      },
      [this, job](const absl::Status& status) {
        if (status.ok()) return;
        resources_->log().warn("event=manifest_not_written job={} error={}", job.value(),
                               logging::Quoted(status.message()));
      });
}

void OperatorCalls::Reschedule(Farm* farm, ActiveJob* active, const v1::Scheduling& scheduling) const {
  const JobId& job = active->record.id;
  const v1::Scheduling before = std::exchange(active->record.scheduling, scheduling);
  if (scheduling.paused() != before.paused()) {
    resources_->log().info("event={} job={}", scheduling.paused() ? "job_paused" : "job_resumed",
                           job.value());
    farm->UpdatePause(job);
  }
  if (scheduling.priority() != before.priority()) {
    resources_->log().info("event=job_priority job={} priority={}", job.value(), scheduling.priority());
    farm->scheduler.jobs().SetPriority(job, scheduling.priority());
    farm->frames.SetPriority(job, scheduling.priority());
  }
  if (scheduling.turn_ms() != before.turn_ms()) {
    resources_->log().info("event=job_moved_to_front job={}", job.value());
    farm->scheduler.jobs().SetTurn(job, scheduling.turn_ms());
    farm->frames.SetTurn(job, scheduling.turn_ms());
  }
  farm->watchers.MarkChanged(job);
}

absl::StatusOr<v1::JobStatus> OperatorCalls::PauseJob(const std::string& job_id) {
  return ChangeScheduling(job_id, [](v1::Scheduling* scheduling) { scheduling->set_paused(true); });
}

absl::StatusOr<v1::JobStatus> OperatorCalls::ResumeJob(const std::string& job_id) {
  return ChangeScheduling(job_id, [](v1::Scheduling* scheduling) { scheduling->set_paused(false); });
}

absl::StatusOr<v1::JobStatus> OperatorCalls::SetJobPriority(const v1::SetJobPriorityRequest& request) {
  if (absl::Status status = job::CheckPriority(request.priority()); !status.ok()) return status;
  return ChangeScheduling(request.job_id(), [&](v1::Scheduling* scheduling) {
    if (!request.to_front()) return scheduling->set_priority(request.priority());
    const JobId job(request.job_id());
    const FarmState::View farm(state_);
    if (farm->scheduler.jobs().Has(job)) scheduling->set_turn_ms(farm->scheduler.jobs().TurnOfFirst(job) - 1);
  });
}

absl::StatusOr<v1::ListWorkersResponse> OperatorCalls::ListWorkers(const v1::ListWorkersRequest& request) {
  const absl::StatusOr<int> limit = LimitOf(request.limit());
  if (!limit.ok()) return limit.status();
  v1::ListWorkersResponse response;
  if (!request.worker().empty()) {
    FarmState::View farm(state_);
    const absl::StatusOr<NamedWorkers> named = FindWorkers(*farm, request.worker());
    if (named.ok()) AddWithHistory(*farm, *named, &response);
    return response;
  }
  absl::string_view token = request.page_token();
  WorkerId after(std::numeric_limits<int64_t>::max());  // all connected workers are on pages before
  std::string blocked_after;
  if (absl::ConsumePrefix(&token, kBlockedToken)) {
    blocked_after = std::string(token);
  } else if (const std::optional<WorkerId> id = job::ParseWorkerId(token)) {
    after = *id;
  } else if (token.empty()) {
    after = WorkerId(0);
  } else {
    return absl::InvalidArgumentError(
        absl::StrCat("page_token ", logging::Quoted(request.page_token()), " is not one of this call's"));
  }
  FarmState::View farm(state_);
  AddWorkers(*farm, after, *limit, request.job_id(), &response);
  if (response.workers_size() == *limit) {
    response.set_next_page_token(response.workers().rbegin()->worker_id());
    return response;
  }
  if (!request.job_id().empty()) return response;
  for (const scheduler::BlockedWorker& blocked : farm->scheduler.workers().Blocked()) {
    if (blocked.name <= blocked_after || !farm->scheduler.workers().Named(blocked.name).empty()) continue;
    if (response.workers_size() == *limit) {
      response.set_next_page_token(kBlockedToken + response.workers().rbegin()->name());
      break;
    }
    *response.add_workers() = GoneWorker(blocked.name, blocked.reason);
  }
  return response;
}

absl::StatusOr<v1::WorkerStatus> OperatorCalls::DrainWorker(const v1::WorkerRequest& request) {
  FarmState::Change farm(state_);
  const absl::StatusOr<NamedWorkers> found = FindWorkers(*farm, request.worker());
  if (!found.ok()) return found.status();
  if (found->connected.empty())
    return absl::NotFoundError(
        absl::StrCat("no worker ", logging::Quoted(request.worker()), " is connected"));
  v1::CoordinatorMessage message;
  message.mutable_drain()->set_finish_units(request.finish_units());
  for (const WorkerId worker : found->connected) {
    resources_->log().info("event=worker_drained worker={}", farm->workers.NameOf(worker));
    farm->scheduler.workers().Drain(worker);
    farm->workers.Send(worker, message);
  }
  return StatusOf(*farm, *farm->scheduler.workers().Describe(found->connected.front()));
}

absl::StatusOr<v1::WorkerStatus> OperatorCalls::BlockWorker(const v1::WorkerRequest& request) {
  absl::MutexLock one_change(&mutex_);
  const absl::StatusOr<NamedWorkers> found = FindWorkers(*FarmState::View(state_), request.worker());
  if (!found.ok()) return found.status();
  const std::string reason = rpc::BoundedLine(request.reason(), rpc::kMaxReasonBytes);
  if (absl::Status status = resources_->store->BlockWorker(found->name, reason); !status.ok())
    return resources_->NoteError(status);
  FarmState::Change farm(state_);
  resources_->log().warn("event=worker_blocked worker={} reason={}", LogName(*farm, found->name),
                         logging::Quoted(reason));
  farm->scheduler.workers().Block(found->name, reason);
  return StatusOfName(*farm, found->name, reason);
}

absl::StatusOr<v1::WorkerStatus> OperatorCalls::ReadmitWorker(const v1::WorkerRequest& request) {
  absl::MutexLock one_change(&mutex_);
  const absl::StatusOr<NamedWorkers> found = FindWorkers(*FarmState::View(state_), request.worker());
  if (!found.ok()) return found.status();
  const absl::Status recorded = resources_->store->ReadmitWorker(found->name);
  if (!recorded.ok() && !absl::IsNotFound(recorded)) return resources_->NoteError(recorded);
  FarmState::Change farm(state_);
  if (!farm->scheduler.workers().Readmit(found->name))
    return absl::NotFoundError(
        absl::StrCat("no worker ", logging::Quoted(request.worker()), " is connected or blocked"));
  resources_->log().info("event=worker_readmitted worker={}", LogName(*farm, found->name));
  return StatusOfName(*farm, found->name, "");
}

absl::Status OperatorCalls::ReadBlockedWorkers() {
  absl::MutexLock one_change(&mutex_);
  const absl::StatusOr<std::vector<ledger::BlockedWorker>> recorded = resources_->store->BlockedWorkers();
  if (!recorded.ok()) return recorded.status();
  FarmState::Change farm(state_);
  std::set<std::string> lifted;
  for (const scheduler::BlockedWorker& worker : farm->scheduler.workers().Blocked())
    lifted.insert(worker.name);
  for (const ledger::BlockedWorker& worker : *recorded) {
    if (lifted.erase(worker.name) == 0) farm->scheduler.workers().Block(worker.name, worker.reason);
  }
  for (const std::string& name : lifted) farm->scheduler.workers().Readmit(name);
  return absl::OkStatus();
}

}  // namespace lumifold::server
