// What clients ask of the coordinator.
#include <spdlog/logger.h>

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "filter/methods.h"
#include "proto/logging/fields.h"
#include "proto/logging/job_labels.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/trace_context.h"
#include "proto/rpc/version.h"
#include "server/coordinator/coordinator.h"
#include "server/coordinator/demand.h"
#include "server/coordinator/job_status.h"
#include "server/coordinator/list_limit.h"
#include "server/film/result_digest.h"
#include "server/job/frame_list.h"
#include "server/job/ids.h"
#include "server/job/job_spec.h"
#include "server/job/job_state.h"
#include "server/job/limits.h"
#include "server/job/scheduling.h"
#include "server/preview/make_preview.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;

namespace {

constexpr size_t kMaxListedErrorBytes = 256;
/// Bytes of a submission besides its spec: the request id, and the scheduling with its names.
constexpr size_t kMaxSubmissionRestBytes = size_t{64} << 10;
static_assert(job::kMaxSpecBytes + kMaxSubmissionRestBytes < rpc::kMaxMessageBytes,
              "a submission with the largest spec fits a message, and so does the spec alone");

absl::Status CheckMethod(const v1::JobSpec& spec) {
  const std::string& method = spec.filter().method();
  const absl::Status status =
      spec.has_adaptive() ? filter::CheckDeviation(method) : filter::CheckMethod(method);
  return status.ok() ? status : absl::InvalidArgumentError(absl::StrCat("filter.method: ", status.message()));
}

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

absl::StatusOr<v1::FindMissingAssetsResponse> Coordinator::FindMissingAssets(
    const v1::FindMissingAssetsRequest& request) const {
  v1::FindMissingAssetsResponse response;
  std::set<std::string> seen;
  for (const v1::AssetRef& asset : request.assets()) {
    if (!rpc::IsSha256Hex(asset.sha256())) {
      return absl::InvalidArgumentError(
          absl::StrCat("asset '", asset.uri(), "': sha256 is not 64 lower-case hexadecimal digits"));
    }
    if (seen.insert(asset.sha256()).second && !assets_->Has(asset.sha256())) {
      response.add_missing_sha256(asset.sha256());
    }
  }
  return response;
}

absl::StatusOr<v1::FindUploadResponse> Coordinator::FindUpload(const v1::FindUploadRequest& request) const {
  v1::FindUploadResponse response;
  response.set_received_bytes(assets_->ReceivedBytes(request.asset().sha256()));
  return response;
}

absl::StatusOr<std::unique_ptr<AssetUpload>> Coordinator::ReceiveAsset(const v1::AssetRef& asset,
                                                                       const std::string& caller) {
  if (absl::Status status = storage_.status(); !status.ok()) return status;
  return assets_->Receive(asset, caller);
}

absl::Status Coordinator::CheckSpec(const v1::JobSpec& spec) const {
  if (absl::Status status = CheckMethod(spec); !status.ok()) return status;
  std::vector<v1::AssetRef> assets(spec.scene().dependencies().begin(), spec.scene().dependencies().end());
  assets.insert(assets.begin(), spec.scene().file());
  for (const v1::AssetRef& asset : assets) {
    const std::string name = asset.uri().empty() ? "scene.file" : absl::StrCat("'", asset.uri(), "'");
    if (!rpc::IsSha256Hex(asset.sha256())) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, ": sha256 is not 64 lower-case hexadecimal digits"));
    }
    if (!assets_->Has(asset.sha256())) {
      return absl::FailedPreconditionError(
          absl::StrCat("asset ", asset.sha256(), " (", name, ") is missing"));
    }
  }
  return absl::OkStatus();
}

absl::Status Coordinator::CheckAssetBytes(const v1::JobSpec& spec) const {
  // What lies here, not what the client says. A file that several names refer to counts once for each.
  uint64_t bytes = assets_->SizeOf(spec.scene().file().sha256());
  for (const v1::AssetRef& asset : spec.scene().dependencies()) bytes += assets_->SizeOf(asset.sha256());
  if (bytes <= options_.limits.job_asset_bytes) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrCat("the files of the scene have ", bytes,
                                                   " bytes; the limit of a job is ",
                                                   options_.limits.job_asset_bytes));
}

absl::Status Coordinator::BeginSubmission(const std::string& user) {
  absl::MutexLock lock(&mutex_);
  int64_t jobs = 0;
  for (const auto& [id, record] : active_jobs_) jobs += record.scheduling.user() == user ? 1 : 0;
  for (const auto& [id, job] : suspended_jobs_) jobs += job.shown.scheduling().user() == user ? 1 : 0;
  int& submissions = submissions_[user];
  if (jobs + submissions >= options_.limits.jobs_per_user) {
    if (submissions == 0) submissions_.erase(user);
    return absl::ResourceExhaustedError(absl::StrCat("user ", logging::Quoted(user), " has ", jobs,
                                                     " active jobs; the limit is ",
                                                     options_.limits.jobs_per_user));
  }
  ++submissions;
  return absl::OkStatus();
}

void Coordinator::EndSubmission(const std::string& user) {
  absl::MutexLock lock(&mutex_);
  const auto found = submissions_.find(user);
  if (--found->second == 0) submissions_.erase(found);
}

absl::StatusOr<v1::SubmitJobResponse> Coordinator::SubmitJob(const v1::SubmitJobRequest& request) {
  if (request.request_id().empty() || request.request_id().size() > job::kMaxRequestIdBytes) {
    return absl::InvalidArgumentError(absl::StrCat("request_id has ", request.request_id().size(),
                                                   " bytes, not 1 to ", job::kMaxRequestIdBytes));
  }
  if (request.spec().has_plan())
    return absl::InvalidArgumentError("plan is set by the coordinator; planning says how");
  absl::StatusOr<v1::JobSpec> spec = job::NormaliseJobSpec(request.spec());
  if (!spec.ok()) return spec.status();
  absl::StatusOr<v1::Scheduling> scheduling = job::NormaliseScheduling(request.scheduling());
  if (!scheduling.ok()) return scheduling.status();
  if (absl::Status status = storage_.status(); !status.ok()) return status;
  ledger::NewJob job{.id = {},
                     .request_id = request.request_id(),
                     .spec = *std::move(spec),
                     .scheduling = *std::move(scheduling),
                     .submitted = absl::InfinitePast(),
                     .owner = owner_};
  // First: limits and conditions are those of new jobs. A client that did not get the answer to its submission must get
  // it by a repetition.
  const absl::StatusOr<std::optional<JobId>> recorded = store_->FindRequest(job);
  if (!recorded.ok()) return NoteError(recorded.status());
  const absl::StatusOr<JobId> id =
      recorded->has_value() ? StartIfUncertain(**recorded) : SubmitNewJob(std::move(job));
  if (!id.ok()) return NoteError(id.status());
  v1::SubmitJobResponse response;
  response.set_job_id(id->value());
  return response;
}

absl::StatusOr<JobId> Coordinator::SubmitNewJob(ledger::NewJob job) {
  if (absl::Status status = janitor_.CheckQuota(); !status.ok()) return status;
  if (absl::Status status = CheckSpec(job.spec); !status.ok()) return status;
  if (absl::Status status = CheckAssetBytes(job.spec); !status.ok()) return status;
  const absl::StatusOr<std::vector<job::Prerequisite>> after = CheckAfter(job.scheduling);
  if (!after.ok()) return after.status();
  const std::string user = job.scheduling.user();
  if (absl::Status status = BeginSubmission(user); !status.ok()) return status;
  job.submitted = options_.wall_now();
  job.id = job::MakeJobId(job.submitted, options_.random());
  if (!rpc::IsTraceId(job.scheduling.trace_id()))
    job.scheduling.set_trace_id(rpc::MakeTraceId(options_.random));
  absl::StatusOr<JobId> id = RecordJob(job, *after);
  EndSubmission(user);
  return id;
}

absl::StatusOr<JobId> Coordinator::RecordJob(const ledger::NewJob& job,
                                             const std::vector<job::Prerequisite>& after) {
  // First the manifest: a job that is in the ledger can be rebuilt from the folder.
  if (absl::Status status = WriteManifest(folder_, ManifestOf(job)); !status.ok()) {
    DeleteFiles(folder_.FilmPath(job.id));
    return status;
  }
  absl::StatusOr<JobId> id = store_->CreateJob(job);
  if (IsStorageError(id.status())) {
    // It may be recorded: the manifest stays, and the job is started when the client, or the next start, finds it.
    absl::MutexLock lock(&mutex_);
    uncertain_jobs_.insert(job.id);
    return id;
  }
  if (!id.ok() || *id != job.id) DeleteFiles(folder_.FilmPath(job.id));
  if (!id.ok()) return id;
  if (*id == job.id) {
    ledger::JobRecord record;
    record.id = job.id;
    record.spec = job.spec;
    record.scheduling = job.scheduling;
    record.owner = job.owner;
    record.submitted = job.submitted;
    StartJob(std::move(record), after, /*was_uncertain=*/false);
    return id;
  }
  return StartIfUncertain(*id);  // another call with the same request was faster
}

absl::StatusOr<JobId> Coordinator::StartIfUncertain(const JobId& id) {
  {
    absl::MutexLock lock(&mutex_);
    if (!uncertain_jobs_.contains(id)) return id;  // the job was started when it was recorded
  }
  absl::StatusOr<ledger::JobRecord> recorded = store_->GetJob(id);
  if (!recorded.ok()) return recorded.status();
  const absl::StatusOr<std::vector<job::Prerequisite>> recorded_after =
      ReadPrerequisites(recorded->scheduling);
  if (!recorded_after.ok()) return recorded_after.status();
  StartJob(*std::move(recorded), *recorded_after, /*was_uncertain=*/true);
  return id;
}

void Coordinator::LabelJob(const JobId& job, const v1::Scheduling& scheduling) const {
  if (options_.labels == nullptr) return;
  options_.labels->Set(job.value(), {.trace = scheduling.trace_id(), .user = scheduling.user()});
}

void Coordinator::StartJob(ledger::JobRecord record, const std::vector<job::Prerequisite>& after,
                           bool was_uncertain) {
  const JobId id = record.id;
  LabelJob(id, record.scheduling);
  {
    absl::MutexLock lock(&mutex_);
    // Another call may have started it, and it may have ended since.
    if (was_uncertain && uncertain_jobs_.erase(id) == 0) return;
    scheduler_.AddJob(id, record.spec, scheduler::OptionsOf(record.scheduling));
    LimitFramesFor(id);
    options_.log->info("event=job_submitted job={} scene={} size={}x{} spp={} frames={}", id.value(),
                       logging::Quoted(record.spec.scene().display_name()), record.spec.width(),
                       record.spec.height(), record.spec.samples_per_pixel(),
                       job::FrameList(record.spec).count());
    active_jobs_.emplace(id, std::move(record));
    AwaitPrerequisites(id, after);
    GrantLeases();
  }
  CheckPrerequisites(after);
}

std::optional<v1::JobStatus> Coordinator::StatusInMemory(const JobId& job) {
  const auto active = active_jobs_.find(job);
  if (active != active_jobs_.end()) {
    v1::JobStatus status = StatusOfActiveJob(active->second, scheduler_.Progress(job));
    if (dependencies_.IsWaiting(job)) status.set_state(v1::JOB_STATE_SUBMITTED);
    status.set_coordinator(address_);
    if (const auto error = predicted_errors_.find(job);
        error != predicted_errors_.end() && !status.has_estimated_error())
      status.set_estimated_error(error->second);
    return status;
  }
  const auto suspended = suspended_jobs_.find(job);
  if (suspended != suspended_jobs_.end()) return suspended->second.shown;
  const auto ending = ending_jobs_.find(job);
  if (ending != ending_jobs_.end()) return ending->second.shown;
  return std::nullopt;
}

absl::StatusOr<v1::JobStatus> Coordinator::StatusOf(const JobId& job) {
  {
    absl::MutexLock lock(&mutex_);
    if (const std::optional<v1::JobStatus> status = StatusInMemory(job)) return *status;
  }
  // A job that leaves memory is in the ledger before.
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  return StatusOfRecord(*record);
}

absl::Status Coordinator::CheckHasEnded(const v1::JobStatus& status) {
  if (job::HasEnded(status.state())) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("job ", status.job_id(), " is being taken over by this coordinator, or by another one"));
}

absl::StatusOr<v1::JobStatus> Coordinator::GetJob(const std::string& job_id) {
  return StatusOf(JobId(job_id));
}

absl::StatusOr<std::string> Coordinator::UserOf(const std::string& job_id) {
  const JobId job(job_id);
  {
    absl::MutexLock lock(&mutex_);
    const auto active = active_jobs_.find(job);
    if (active != active_jobs_.end()) return active->second.scheduling.user();
    if (const std::optional<v1::JobStatus> status = StatusInMemory(job)) return status->scheduling().user();
  }
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  return record->scheduling.user();
}

absl::StatusOr<v1::ListJobsResponse> Coordinator::ListJobs(const v1::ListJobsRequest& request) {
  absl::StatusOr<ledger::JobFilter> filter = FilterOf(request);
  if (!filter.ok()) return filter.status();
  const int limit = filter->limit;
  v1::ListJobsResponse response;
  do {
    filter->limit = limit - response.jobs_size();
    const absl::StatusOr<ledger::JobPage> page = store_->ListJobs(*filter);
    if (!page.ok()) return page.status();
    if (absl::Status status = AddListed(*page, request, &response); !status.ok()) return status;
    filter->before = page->next;
  } while (filter->before.has_value() && response.jobs_size() < limit);
  if (filter->before.has_value()) response.set_next_page_token(absl::StrCat(*filter->before));
  return response;
}

absl::Status Coordinator::AddListed(const ledger::JobPage& page, const v1::ListJobsRequest& request,
                                    v1::ListJobsResponse* response) {
  const auto add = [&](v1::JobStatus status) {
    const auto& states = request.states();
    if (!states.empty() && std::find(states.begin(), states.end(), status.state()) == states.end()) return;
    // A thousand jobs must fit a message: their warnings and long errors are in GetJob.
    status.clear_warnings();
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

absl::StatusOr<bool> Coordinator::IsFinished(const JobId& job, int32_t frame) {
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  LabelJob(job, record->scheduling);  // it may have ended before this coordinator started
  if (!job::FrameList(record->spec).IndexOf(frame).has_value())
    return absl::NotFoundError(absl::StrCat("job ", job.value(), " has no frame ", frame));
  const absl::StatusOr<std::vector<int32_t>> finished = store_->FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  return std::binary_search(finished->begin(), finished->end(), frame);
}

absl::StatusOr<int64_t> Coordinator::CountUnits(const JobId& job, int32_t frame) {
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

absl::StatusOr<rpc::ByteSender> Coordinator::OpenResult(const v1::DownloadResultRequest& request) {
  const JobId job(request.job_id());
  const absl::StatusOr<bool> is_finished = IsFinished(job, request.frame());
  if (!is_finished.ok()) return is_finished.status();
  if (!*is_finished) {
    return absl::FailedPreconditionError(
        absl::StrCat("frame ", request.frame(), " of job ", request.job_id(), " is not ready"));
  }
  const std::string path = folder_.ResultPath(job, request.frame());
  absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::Open(path, request.offset());
  if (!sender.ok()) return sender;
  absl::StatusOr<std::string> digest = film::ResultDigest(path);
  if (!digest.ok()) return digest.status();
  sender->SetSha256(*std::move(digest));
  options_.log->info("event=result_opened job={} frame={} offset={}", job.value(), request.frame(),
                     request.offset());
  return sender;
}

absl::Status Coordinator::Watch(const std::string& job_id, JobWatcher* watcher) {
  const JobId job(job_id);
  {
    absl::MutexLock lock(&mutex_);
    if (const std::optional<v1::JobStatus> status = StatusInMemory(job)) {
      watchers_[watcher] = job;
      watcher->OnStatus(*status);
      return absl::OkStatus();
    }
  }
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status.status();
  watcher->OnStatus(*status);  // there will be no other
  return CheckHasEnded(*status);
}

void Coordinator::Unwatch(JobWatcher* watcher) {
  absl::MutexLock lock(&mutex_);
  watchers_.erase(watcher);
}

absl::StatusOr<v1::ServerStatus> Coordinator::GetServerStatus() {
  v1::ServerStatus status;
  status.set_version(std::string(rpc::kVersion));
  status.set_insecure(options_.insecure);
  const absl::StatusOr<uint64_t> free_bytes = folder_.FreeBytes();
  status.set_free_bytes(free_bytes.value_or(0));
  if (const std::optional<StorageState::Outage> outage = storage_.outage()) {
    status.set_storage_error(outage->error);
    status.set_storage_error_since_unix_ms(absl::ToUnixMillis(outage->since));
  }
  absl::MutexLock lock(&mutex_);
  status.set_workers(static_cast<int32_t>(workers_.size()));
  for (const auto& [id, worker] : workers_) status.set_slots(status.slots() + worker.slots);
  status.set_leases(static_cast<int32_t>(scheduler_.lease_count()));
  status.set_frames_in_flight(scheduler_.frames_in_flight());
  status.set_active_jobs(static_cast<int64_t>(active_jobs_.size()));
  DemandSum demand;
  for (const auto& [id, record] : active_jobs_) demand.Add(record.scheduling, scheduler_.Progress(id));
  demand.AddTo(&status);
  return status;
}

}  // namespace lumifold::server
