// What operators ask of the coordinator.
#include <spdlog/logger.h>

#include <algorithm>
#include <limits>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "server/coordinator/coordinator.h"
#include "server/coordinator/event_log.h"
#include "server/coordinator/job_status.h"
#include "server/coordinator/list_limit.h"
#include "server/job/job_state.h"
#include "server/job/scheduling.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;
using job::WorkerId;

namespace {

/// Bytes of the events of one answer, and what each takes beside its text.
constexpr size_t kMaxLogBytes = size_t{3} << 20;
constexpr size_t kEventOverheadBytes = 16;
/// Jobs that a reason names.
constexpr size_t kMaxNamedJobs = 4;
/// Prefix of page tokens after the connected workers; the name of a blocked worker follows.
constexpr char kBlockedToken[] = "b-";

v1::WorkerStatus ProtoFromWorker(const scheduler::WorkerInfo& info, absl::Time connected) {
  v1::WorkerStatus status;
  status.set_worker_id(TextOf(info.worker));
  status.set_name(info.traits.name);
  status.set_state(info.state);
  status.set_reason(info.reason);
  status.set_numeric_class(info.traits.numeric_class);
  for (const std::string& tag : info.traits.tags) status.add_tags(tag);
  status.set_slots(info.traits.slots);
  status.set_leases(info.leases);
  status.set_units_done(info.units_done);
  status.set_units_failed(info.units_failed);
  status.set_seconds_per_unit(absl::ToDoubleSeconds(info.mean_time));
  status.set_connected_unix_ms(absl::ToUnixMillis(connected));
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

void AddReason(const std::string& code, const std::string& text, v1::ExplainJobResponse* response) {
  v1::Reason* reason = response->add_reasons();
  reason->set_code(code);
  reason->set_text(text);
}

std::string TextOf(const std::vector<JobId>& waits_for) {
  const size_t named = std::min(waits_for.size(), kMaxNamedJobs);
  std::string text = absl::StrCat(
      "the job waits until these are done: ",
      absl::StrJoin(waits_for.begin(), waits_for.begin() + static_cast<std::ptrdiff_t>(named), ", ",
                    [](std::string* out, const JobId& job) { absl::StrAppend(out, job.value()); }));
  if (named < waits_for.size()) absl::StrAppend(&text, " and ", waits_for.size() - named, " more");
  return text;
}

}  // namespace

absl::StatusOr<v1::JobStatus> Coordinator::ChangeScheduling(const std::string& job_id,
                                                            absl::FunctionRef<void(v1::Scheduling*)> change) {
  const JobId job(job_id);
  // Two changes of a job at the same time must not lose one of them. Held during the call of the ledger.
  absl::MutexLock one_change(&control_mutex_);
  v1::Scheduling scheduling;
  bool is_active = false;
  {
    absl::MutexLock lock(&mutex_);
    const auto active = active_jobs_.find(job);
    is_active = active != active_jobs_.end();
    if (is_active) scheduling = active->second.scheduling;
  }
  absl::Status recorded;
  if (is_active) {
    change(&scheduling);
    recorded = store_->SetScheduling(Owned(job), scheduling);
    if (IsStorageError(recorded)) return NoteError(recorded);
    if (recorded.ok()) RecordScheduling(job, scheduling);
  }
  {
    absl::MutexLock lock(&mutex_);
    const auto active = active_jobs_.find(job);
    if (is_active && recorded.ok() && active != active_jobs_.end()) {
      Reschedule(job, scheduling);
      active->second.scheduling = scheduling;
      changed_jobs_.insert(job);
      housekeeping_.Notify();
      GrantLeases();
      return StatusOfActiveJob(active->second, scheduler_.Progress(job));
    }
  }
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status;
  if (absl::Status ended = CheckHasEnded(*status); !ended.ok()) return ended;
  return absl::FailedPreconditionError(absl::StrCat("job ", job_id, " has ended"));
}

void Coordinator::RecordScheduling(const JobId& job, const v1::Scheduling& scheduling) {
  // By the committer, so that it cannot write the manifest of a job that ends meanwhile.
  committer_->Write(
      [this, job, scheduling] {
        return IsWanted(job) ? RewriteManifest(folder_, job, scheduling) : absl::OkStatus();
      },
      [this, job](const absl::Status& status) {
        if (status.ok()) return;
        options_.log->warn("event=manifest_not_written job={} error={}", job.value(),
                           logging::Quoted(std::string(status.message())));
      });
}

void Coordinator::Reschedule(const JobId& job, const v1::Scheduling& scheduling) {
  const v1::Scheduling& before = active_jobs_.at(job).scheduling;
  if (scheduling.paused() && !before.paused()) {
    options_.log->info("event=job_paused job={}", job.value());
    scheduler_.PauseJob(job);
  }
  if (!scheduling.paused() && before.paused()) {
    options_.log->info("event=job_resumed job={}", job.value());
    if (!wanted_assets_.contains(job)) scheduler_.ResumeJob(job);
  }
  if (scheduling.priority() != before.priority()) {
    options_.log->info("event=job_priority job={} priority={}", job.value(), scheduling.priority());
    scheduler_.SetPriority(job, scheduling.priority());
  }
}

absl::StatusOr<v1::JobStatus> Coordinator::PauseJob(const std::string& job_id) {
  return ChangeScheduling(job_id, [](v1::Scheduling* scheduling) { scheduling->set_paused(true); });
}

absl::StatusOr<v1::JobStatus> Coordinator::ResumeJob(const std::string& job_id) {
  return ChangeScheduling(job_id, [](v1::Scheduling* scheduling) { scheduling->set_paused(false); });
}

absl::StatusOr<v1::JobStatus> Coordinator::SetJobPriority(const v1::SetJobPriorityRequest& request) {
  if (absl::Status status = job::CheckPriority(request.priority()); !status.ok()) return status;
  return ChangeScheduling(request.job_id(),
                          [&](v1::Scheduling* scheduling) { scheduling->set_priority(request.priority()); });
}

absl::StatusOr<v1::ExplainJobResponse> Coordinator::ExplainJob(const std::string& job_id) {
  const absl::StatusOr<v1::JobStatus> status = GetJob(job_id);
  if (!status.ok()) return status.status();
  v1::ExplainJobResponse response;
  *response.mutable_status() = *status;
  const absl::StatusOr<v1::Plan> plan = PlanOf(JobId(job_id));
  if (!plan.ok()) return plan.status();
  if (plan->decisions_size() > 0) *response.mutable_plan() = *plan;
  if (status->state() == v1::JOB_STATE_FAILED) AddReason("failed", status->error(), &response);
  if (status->state() == v1::JOB_STATE_CANCELLED) AddReason("cancelled", "the job was cancelled", &response);
  if (job::HasEnded(status->state())) return response;
  if (const absl::Status storage = storage_.status(); !storage.ok())
    AddReason("storage", std::string(storage.message()), &response);
  const JobId job(job_id);
  absl::MutexLock lock(&mutex_);
  if (const std::vector<JobId> waits_for = dependencies_.WaitsFor(job); !waits_for.empty())
    AddReason("after", TextOf(waits_for), &response);
  ExplainAsset(job, &response);
  const bool is_paused = status->scheduling().paused();
  for (const scheduler::Reason& reason : scheduler_.Explain(job, options_.now())) {
    if (reason.code != "paused" || is_paused) AddReason(reason.code, reason.text, &response);
  }
  ExplainFinishing(job, &response);
  return response;
}

void Coordinator::ExplainFinishing(const JobId& job, v1::ExplainJobResponse* response) {
  const absl::Time now = options_.now();
  int64_t position = 0;
  bool is_first = true;
  for (const CommittedFrame& frame : committed_frames_) {
    if (frame.not_before <= now) ++position;
    if (frame.job != job) continue;
    if (frame.not_before > now && frame.failures > 0) {
      AddReason(
          "filter_retry",
          absl::StrCat("the filter of frame ", frame.number, " failed ", frame.failures,
                       " times and is tried again in ",
                       absl::ToInt64Seconds(absl::Ceil(frame.not_before - now, absl::Seconds(1))), " s"),
          response);
    } else if (is_first) {
      AddReason("filter_queue",
                absl::StrCat("frame ", frame.number, " waits for the filter, ", position - 1,
                             " frames of this and other jobs before it"),
                response);
      is_first = false;
    }
  }
}

absl::StatusOr<v1::ListWorkersResponse> Coordinator::ListWorkers(const v1::ListWorkersRequest& request) {
  const absl::StatusOr<int> limit = LimitOf(request.limit());
  if (!limit.ok()) return limit.status();
  v1::ListWorkersResponse response;
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
  absl::MutexLock lock(&mutex_);
  AddWorkers(after, *limit, request.job_id(), &response);
  if (response.workers_size() == *limit) {
    response.set_next_page_token(response.workers().rbegin()->worker_id());
    return response;
  }
  if (!request.job_id().empty()) return response;
  for (const scheduler::BlockedWorker& blocked : scheduler_.Blocked()) {
    if (blocked.name <= blocked_after || !scheduler_.WorkersNamed(blocked.name).empty()) continue;
    if (response.workers_size() == *limit) {
      response.set_next_page_token(kBlockedToken + response.workers().rbegin()->name());
      break;
    }
    *response.add_workers() = GoneWorker(blocked.name, blocked.reason);
  }
  return response;
}

void Coordinator::AddWorkers(WorkerId after, int limit, const std::string& job,
                             v1::ListWorkersResponse* response) const {
  while (true) {
    const std::vector<scheduler::WorkerInfo> some = scheduler_.Workers(after, limit);
    for (const scheduler::WorkerInfo& info : some) {
      v1::WorkerStatus status = StatusOf(info);
      const auto& jobs = status.job_ids();
      if (!job.empty() && std::find(jobs.begin(), jobs.end(), job) == jobs.end()) continue;
      *response->add_workers() = std::move(status);
      if (response->workers_size() == limit) return;
    }
    if (some.empty()) return;
    after = some.back().worker;
  }
}

v1::WorkerStatus Coordinator::StatusOf(const scheduler::WorkerInfo& info) const {
  const ConnectedWorker& worker = workers_.at(info.worker);
  v1::WorkerStatus status = ProtoFromWorker(info, worker.connected);
  status.set_process(worker.process);
  return status;
}

absl::StatusOr<Coordinator::NamedWorkers> Coordinator::FindWorkers(const std::string& worker) {
  if (worker.empty() || worker.size() > rpc::kMaxWorkerNameBytes)
    return absl::InvalidArgumentError(
        absl::StrCat("worker has ", worker.size(), " bytes, not 1 to ", rpc::kMaxWorkerNameBytes));
  if (const std::optional<WorkerId> id = job::ParseWorkerId(worker)) {
    const std::optional<scheduler::WorkerInfo> info = scheduler_.DescribeWorker(*id);
    if (!info.has_value()) return absl::NotFoundError(absl::StrCat("no worker ", worker, " is connected"));
    return NamedWorkers{info->traits.name, {*id}};
  }
  const std::string name = logging::OneWord(worker);
  return NamedWorkers{name, scheduler_.WorkersNamed(name)};
}

absl::StatusOr<v1::WorkerStatus> Coordinator::DrainWorker(const v1::WorkerRequest& request) {
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<NamedWorkers> found = FindWorkers(request.worker());
  if (!found.ok()) return found.status();
  if (found->connected.empty())
    return absl::NotFoundError(
        absl::StrCat("no worker ", logging::Quoted(request.worker()), " is connected"));
  v1::CoordinatorMessage message;
  message.mutable_drain();
  for (const WorkerId worker : found->connected) {
    options_.log->info("event=worker_drained worker={}", NameOf(worker));
    scheduler_.DrainWorker(worker);
    workers_.at(worker).sink->Send(message);
  }
  return StatusOf(*scheduler_.DescribeWorker(found->connected.front()));
}

absl::StatusOr<v1::WorkerStatus> Coordinator::BlockWorker(const v1::WorkerRequest& request) {
  absl::MutexLock one_change(&control_mutex_);
  absl::StatusOr<NamedWorkers> found;
  {
    absl::MutexLock lock(&mutex_);
    found = FindWorkers(request.worker());
  }
  if (!found.ok()) return found.status();
  const std::string reason = rpc::BoundedLine(request.reason(), rpc::kMaxReasonBytes);
  if (absl::Status status = store_->BlockWorker(found->name, reason); !status.ok()) return NoteError(status);
  absl::MutexLock lock(&mutex_);
  const std::vector<WorkerId> connected = scheduler_.WorkersNamed(found->name);
  options_.log->warn("event=worker_blocked worker={} reason={}",
                     connected.empty() ? absl::StrCat("-/", found->name) : NameOf(connected.front()),
                     logging::Quoted(reason));
  scheduler_.BlockWorker(found->name, reason);
  GrantLeases();
  if (connected.empty()) return GoneWorker(found->name, reason);
  return StatusOf(*scheduler_.DescribeWorker(connected.front()));
}

absl::StatusOr<v1::WorkerStatus> Coordinator::ReadmitWorker(const v1::WorkerRequest& request) {
  absl::MutexLock one_change(&control_mutex_);
  absl::StatusOr<NamedWorkers> found;
  {
    absl::MutexLock lock(&mutex_);
    found = FindWorkers(request.worker());
  }
  if (!found.ok()) return found.status();
  const absl::Status recorded = store_->ReadmitWorker(found->name);
  if (!recorded.ok() && !absl::IsNotFound(recorded)) return NoteError(recorded);
  absl::MutexLock lock(&mutex_);
  if (!scheduler_.ReadmitWorker(found->name))
    return absl::NotFoundError(
        absl::StrCat("no worker ", logging::Quoted(request.worker()), " is connected or blocked"));
  const std::vector<WorkerId> connected = scheduler_.WorkersNamed(found->name);
  options_.log->info("event=worker_readmitted worker={}",
                     connected.empty() ? absl::StrCat("-/", found->name) : NameOf(connected.front()));
  GrantLeases();
  if (connected.empty()) return GoneWorker(found->name, "");
  return StatusOf(*scheduler_.DescribeWorker(connected.front()));
}

absl::Status Coordinator::RestoreBlockedWorkers() {
  const absl::StatusOr<std::vector<ledger::BlockedWorker>> blocked = store_->BlockedWorkers();
  if (!blocked.ok()) return blocked.status();
  absl::MutexLock lock(&mutex_);
  for (const ledger::BlockedWorker& worker : *blocked) scheduler_.BlockWorker(worker.name, worker.reason);
  return absl::OkStatus();
}

void Coordinator::KeepLog(WorkerId worker, const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines) {
  if (lines.empty() || options_.events == nullptr) return;
  absl::MutexLock lock(&mutex_);
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return;
  options_.events->AddOfWorker(NameOf(worker), lines, options_.wall_now(), [&](const std::string& job) {
    return found->second.known_jobs.contains(JobId(job));
  });
}

absl::StatusOr<v1::GetLogResponse> Coordinator::GetLog(const v1::GetLogRequest& request) {
  const absl::StatusOr<int> limit = LimitOf(request.limit());
  if (!limit.ok()) return limit.status();
  if (request.job_id().empty() == request.worker().empty())
    return absl::InvalidArgumentError("either job_id or worker must be set");
  std::vector<v1::LogEvent> events;
  if (!request.job_id().empty()) {
    events = options_.events->OfJob(request.job_id(), *limit);
    if (events.empty()) {
      if (absl::Status status = GetJob(request.job_id()).status(); !status.ok()) return status;
    }
  } else {
    events = options_.events->OfWorker(logging::OneWord(request.worker()), *limit);
    if (events.empty())
      return absl::NotFoundError(
          absl::StrCat("no events of a worker ", logging::Quoted(request.worker()), " are kept"));
  }
  v1::GetLogResponse response;
  // A thousand long lines must fit a message: the newest stay.
  size_t bytes = 0;
  size_t first = events.size();
  while (first > 0 && bytes + events[first - 1].ByteSizeLong() < kMaxLogBytes)
    bytes += events[--first].ByteSizeLong() + kEventOverheadBytes;
  for (size_t i = first; i < events.size(); ++i) *response.add_events() = std::move(events[i]);
  return response;
}

}  // namespace lumifold::server
