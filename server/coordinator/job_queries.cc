#include "server/coordinator/job_queries.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/version.h"
#include "server/coordinator/demand.h"
#include "server/coordinator/event_log.h"
#include "server/coordinator/explain.h"
#include "server/coordinator/job_status.h"
#include "server/coordinator/list_limit.h"
#include "server/film/result_digest.h"
#include "server/job/frame_list.h"
#include "server/job/gaps.h"
#include "server/job/job_state.h"
#include "server/preview/make_preview.h"

namespace lumifold::server {

using job::JobId;

namespace {

constexpr size_t kMaxListedErrorBytes = 256;
/// Jobs of one answer about usage, so that it fits a message.
constexpr int kMaxUsageJobs = 10'000;
/// Bytes of the events of one answer, and what each takes beside its text.
constexpr size_t kMaxLogBytes = size_t{3} << 20;
constexpr size_t kEventOverheadBytes = 16;

/// The jobs of the ledger that may be on a page: it does not tell active jobs apart.
absl::StatusOr<ledger::JobFilter> FilterOf(const v1::ListJobsRequest& request) {
  const absl::StatusOr<int> limit = LimitOf(request.limit());
  if (!limit.ok()) return limit.status();
  ledger::JobFilter filter;
  filter.limit = *limit;
  if (int64_t before = 0; !request.page_token().empty()) {
    if (!absl::SimpleAtoi(request.page_token(), &before) || before < 1) {
      return absl::InvalidArgumentError(
          absl::StrCat("page_token ", logging::Quoted(request.page_token()), " is not one of this call's"));
    }
    filter.before = before;
  }
  std::set<v1::JobState> states;
  for (const int value : request.states()) {
    const auto state = static_cast<v1::JobState>(value);
    states.insert(job::HasEnded(state) ? state : v1::JOB_STATE_SUBMITTED);
  }
  filter.states.assign(states.begin(), states.end());
  filter.user = request.user();
  return filter;
}

}  // namespace

absl::StatusOr<v1::JobStatus> JobQueries::StatusOf(const JobId& job) {
  if (const std::optional<v1::JobStatus> status = FarmState::View(state_)->StatusOf(job)) return *status;
  // A job that leaves memory is in the ledger before.
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  return StatusOfRecord(*record);
}

absl::Status JobQueries::CheckHasEnded(const v1::JobStatus& status) {
  if (job::HasEnded(status.state())) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("job ", status.job_id(), " is being taken over by this coordinator, or by another one"));
}

absl::StatusOr<v1::JobStatus> JobQueries::GetJob(const std::string& job_id) {
  absl::StatusOr<v1::JobStatus> status = StatusOf(JobId(job_id));
  if (!status.ok() || status->scheduling().webhook().empty() || !job::HasEnded(status->state()))
    return status;
  const absl::StatusOr<std::optional<v1::WebhookDelivery>> delivery = resources_->webhooks->StatusOf(job_id);
  if (!delivery.ok()) return delivery.status();
  if (delivery->has_value()) *status->mutable_webhook() = **delivery;
  return status;
}

absl::StatusOr<std::string> JobQueries::UserOf(const std::string& job_id) {
  const JobId job(job_id);
  {
    FarmState::View farm(state_);
    if (const ActiveJob* const active = farm->jobs.FindActive(job); active != nullptr)
      return active->record.scheduling.user();
    if (const std::optional<v1::JobStatus> status = farm->StatusOf(job)) return status->scheduling().user();
  }
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  return record->scheduling.user();
}

absl::StatusOr<ledger::Epoch> JobQueries::OwnerOf(const JobId& job) {
  if (FarmState::View(state_)->jobs.IsInMemory(job)) return resources_->owner.epoch;
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  return record->owner.epoch;
}

absl::StatusOr<v1::ListJobsResponse> JobQueries::ListJobs(const v1::ListJobsRequest& request) {
  absl::StatusOr<ledger::JobFilter> filter = FilterOf(request);
  if (!filter.ok()) return filter.status();
  const int limit = filter->limit;
  v1::ListJobsResponse response;
  do {
    filter->limit = limit - response.jobs_size();
    const absl::StatusOr<ledger::JobPage> page = resources_->store->ListJobs(*filter);
    if (!page.ok()) return page.status();
    if (absl::Status status = AddListed(*page, request, &response); !status.ok()) return status;
    filter->before = page->next;
  } while (filter->before.has_value() && response.jobs_size() < limit);
  if (filter->before.has_value()) response.set_next_page_token(absl::StrCat(*filter->before));
  return response;
}

absl::Status JobQueries::AddListed(const ledger::JobPage& page, const v1::ListJobsRequest& request,
                                   v1::ListJobsResponse* response) {
  const auto add = [&](v1::JobStatus status) {
    const auto& states = request.states();
    if (!states.empty() && std::find(states.begin(), states.end(), status.state()) == states.end()) return;
    // A thousand jobs must fit a message: what may be long is in GetJob.
    status.clear_warnings();
    status.clear_settings();
    status.mutable_scheduling()->mutable_gaps()->clear_skipped();
    status.set_error(rpc::BoundedLine(status.error(), kMaxListedErrorBytes));
    *response->add_jobs() = std::move(status);
  };
  for (const ledger::JobRecord& record : page.jobs) {
    // A job that was active when the page was read may have ended since, or be gone.
    absl::StatusOr<v1::JobStatus> status =
        job::HasEnded(record.state) ? StatusOfEndedJob(record) : StatusOf(record.id);
    if (absl::IsNotFound(status.status())) continue;
    if (!status.ok()) return status.status();
    add(*std::move(status));
  }
  for (const ledger::DamagedJob& job : page.damaged) {
    v1::JobStatus status;
    status.set_job_id(job.id.value());
    status.set_state(v1::JOB_STATE_FAILED);
    status.set_error(std::string(job.error.message()));
    add(std::move(status));
  }
  return absl::OkStatus();
}

absl::StatusOr<v1::Plan> JobQueries::PlanOf(const JobId& job) {
  {
    FarmState::View farm(state_);
    if (const ActiveJob* const active = farm->jobs.FindActive(job); active != nullptr)
      return active->record.spec.plan();
  }
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  return record->spec.plan();
}

absl::StatusOr<v1::ExplainJobResponse> JobQueries::ExplainJob(const std::string& job_id) {
  const JobId job(job_id);
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status.status();
  v1::ExplainJobResponse response;
  *response.mutable_status() = *status;
  const absl::StatusOr<v1::Plan> plan = PlanOf(job);
  if (!plan.ok()) return plan.status();
  if (plan->decisions_size() > 0) *response.mutable_plan() = *plan;
  if (status->state() == v1::JOB_STATE_FAILED) AddReason("failed", status->error(), &response);
  if (status->state() == v1::JOB_STATE_CANCELLED) AddReason("cancelled", "the job was cancelled", &response);
  if (status->frames_skipped() > 0) {
    AddReason("skipped",
              absl::StrCat(status->frames_skipped(), " of its ", status->frames_total(),
                           " frames are skipped: ", job::TextOf(status->scheduling().gaps())),
              &response);
  }
  if (job::HasEnded(status->state())) return response;
  if (const absl::Status storage = resources_->storage.status(); !storage.ok())
    AddReason("storage", std::string(storage.message()), &response);
  ExplainWaiting(*FarmState::View(state_), job, resources_->options.now(), &response);
  return response;
}

absl::StatusOr<bool> JobQueries::IsFinished(const JobId& job, int32_t frame) {
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  resources_->LabelJob(job, record->scheduling);  // it may have ended before this coordinator started
  if (!job::FrameList(record->spec).IndexOf(frame).has_value())
    return absl::NotFoundError(absl::StrCat("job ", job.value(), " has no frame ", frame));
  const absl::StatusOr<std::vector<int32_t>> finished = resources_->store->FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  return std::binary_search(finished->begin(), finished->end(), frame);
}

absl::StatusOr<int64_t> JobQueries::CountUnits(const JobId& job, int32_t frame) {
  const absl::StatusOr<bool> is_finished = IsFinished(job, frame);
  if (!is_finished.ok()) return is_finished.status();
  if (*is_finished) return kFinishedUnits;
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status.status();
  if (job::HasEnded(status->state())) {
    return absl::FailedPreconditionError(
        absl::StrCat("job ", job.value(), " has ended without frame ", frame));
  }
  return status->units_done();
}

absl::StatusOr<rpc::ByteSender> JobQueries::OpenResult(const v1::DownloadResultRequest& request) {
  const JobId job(request.job_id());
  const absl::StatusOr<bool> is_finished = IsFinished(job, request.frame());
  if (!is_finished.ok()) return is_finished.status();
  if (!*is_finished) {
    const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
    const bool is_skipped = status.ok() && job::IsSkipped(status->scheduling().gaps(), request.frame());
    return absl::FailedPreconditionError(absl::StrCat("frame ", request.frame(), " of job ", request.job_id(),
                                                      is_skipped ? " is skipped" : " is not ready"));
  }
  const std::string path = resources_->folder.ResultPath(job, request.frame());
  absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::Open(path, request.offset());
  if (!sender.ok()) return sender;
  absl::StatusOr<std::string> digest = film::ResultDigest(path);
  if (!digest.ok()) return digest.status();
  sender->SetSha256(*std::move(digest));
  resources_->log().info("event=result_opened job={} frame={} offset={}", job.value(), request.frame(),
                         request.offset());
  return sender;
}

absl::Status JobQueries::Watch(const std::string& job_id, JobWatcher* watcher) {
  const JobId job(job_id);
  {
    FarmState::Change farm(state_);
    if (const std::optional<v1::JobStatus> status = farm->StatusOf(job)) {
      farm->watchers.Add(watcher, job);
      watcher->OnStatus(*status);
      return absl::OkStatus();
    }
  }
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status.status();
  watcher->OnStatus(*status);  // there will be no other
  return CheckHasEnded(*status);
}

void JobQueries::Unwatch(JobWatcher* watcher) { FarmState::Change(state_)->watchers.Remove(watcher); }

absl::StatusOr<v1::ServerStatus> JobQueries::GetServerStatus() {
  v1::ServerStatus status;
  status.set_version(std::string(rpc::kVersion));
  status.set_insecure(resources_->options.insecure);
  status.set_free_bytes(resources_->folder.FreeBytes().value_or(0));
  if (const std::optional<StorageState::Outage> outage = resources_->storage.outage()) {
    status.set_storage_error(outage->error);
    status.set_storage_error_since_unix_ms(absl::ToUnixMillis(outage->since));
  }
  if (const std::optional<v1::WebhookCounts> counts = resources_->webhooks->counts(); counts.has_value())
    *status.mutable_webhooks() = *counts;
  FarmState::View farm(state_);
  status.set_workers(static_cast<int32_t>(farm->workers.connected().size()));
  for (const auto& [id, worker] : farm->workers.connected()) status.set_slots(status.slots() + worker.slots);
  status.set_leases(static_cast<int32_t>(farm->scheduler.units().lease_count()));
  status.set_frames_in_flight(farm->scheduler.frames().in_flight());
  status.set_active_jobs(static_cast<int64_t>(farm->jobs.active().size()));
  DemandSum demand;
  for (const auto& [id, active] : farm->jobs.active())
    demand.Add(active.record.scheduling, farm->scheduler.jobs().Progress(id));
  demand.AddTo(&status);
  return status;
}

absl::StatusOr<v1::GetUsageResponse> JobQueries::GetUsage(const v1::GetUsageRequest& request) {
  const absl::Time tomorrow = resources_->options.wall_now() + absl::Hours(24);
  const absl::StatusOr<std::vector<ledger::JobUsage>> usage = resources_->store->Usage(
      {.since = absl::FromUnixMillis(request.since_unix_ms()),
       .until = request.until_unix_ms() > 0 ? absl::FromUnixMillis(request.until_unix_ms()) : tomorrow,
       .user = request.user(),
       .limit = kMaxUsageJobs + 1});
  if (!usage.ok()) return usage.status();
  v1::GetUsageResponse response;
  for (const ledger::JobUsage& of_job : *usage) {
    response.set_is_cut(response.jobs_size() == kMaxUsageJobs);
    if (response.is_cut()) break;
    v1::JobUsage* const job = response.add_jobs();
    job->set_job_id(of_job.job.value());
    job->set_user(of_job.user);
    job->set_units(of_job.work.units);
    job->set_render_seconds(of_job.work.render_seconds);
    job->set_frames(of_job.work.frames);
    job->set_finish_seconds(of_job.work.finish_seconds);
  }
  return response;
}

absl::StatusOr<v1::GetLogResponse> JobQueries::GetLog(const v1::GetLogRequest& request) {
  const absl::StatusOr<int> limit = LimitOf(request.limit());
  if (!limit.ok()) return limit.status();
  if (request.job_id().empty() == request.worker().empty())
    return absl::InvalidArgumentError("either job_id or worker must be set");
  std::vector<v1::LogEvent> events;
  if (!request.job_id().empty()) {
    events = resources_->options.job_log.events->OfJob(request.job_id(), *limit);
    if (events.empty()) {
      if (absl::Status status = GetJob(request.job_id()).status(); !status.ok()) return status;
    }
  } else {
    events = resources_->options.job_log.events->OfWorker(logging::OneWord(request.worker()), *limit);
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
