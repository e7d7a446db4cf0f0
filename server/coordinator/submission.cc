#include "server/coordinator/submission.h"

#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/methods.h"
#include "proto/logging/fields.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/trace_context.h"
#include "server/assets/asset_store.h"
#include "server/job/ids.h"
#include "server/job/job_spec.h"
#include "server/job/limits.h"
#include "server/job/scheduling.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;

namespace {

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

}  // namespace

Submission::Submission(Resources* resources, FarmState* state, Cleanup* cleanup,
                       const Prerequisites* prerequisites)
    : resources_(resources), state_(state), cleanup_(cleanup), prerequisites_(prerequisites) {}

absl::StatusOr<v1::FindMissingAssetsResponse> Submission::FindMissingAssets(
    const v1::FindMissingAssetsRequest& request) const {
  v1::FindMissingAssetsResponse response;
  std::set<std::string> seen;
  for (const v1::AssetRef& asset : request.assets()) {
    if (!rpc::IsSha256Hex(asset.sha256())) {
      return absl::InvalidArgumentError(
          absl::StrCat("asset '", asset.uri(), "': sha256 is not 64 lower-case hexadecimal digits"));
    }
    if (seen.insert(asset.sha256()).second && !resources_->assets->Has(asset.sha256())) {
      response.add_missing_sha256(asset.sha256());
    }
  }
  return response;
}

absl::StatusOr<v1::FindUploadResponse> Submission::FindUpload(const v1::FindUploadRequest& request) const {
  v1::FindUploadResponse response;
  response.set_received_bytes(resources_->assets->ReceivedBytes(request.asset().sha256()));
  return response;
}

absl::StatusOr<std::unique_ptr<AssetUpload>> Submission::ReceiveAsset(const v1::AssetRef& asset,
                                                                      const std::string& caller) {
  if (absl::Status status = resources_->storage.status(); !status.ok()) return status;
  return resources_->assets->Receive(asset, caller);
}

void Submission::OnAssetStored(const std::string& sha256) { FarmState::Change(state_)->OnAssetFound(sha256); }

absl::Status Submission::CheckSpec(const v1::JobSpec& spec) const {
  if (absl::Status status = CheckMethod(spec); !status.ok()) return status;
  std::vector<v1::AssetRef> assets(spec.scene().dependencies().begin(), spec.scene().dependencies().end());
  assets.insert(assets.begin(), spec.scene().file());
  for (const v1::AssetRef& asset : assets) {
    const std::string name = asset.uri().empty() ? "scene.file" : absl::StrCat("'", asset.uri(), "'");
    if (!rpc::IsSha256Hex(asset.sha256())) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, ": sha256 is not 64 lower-case hexadecimal digits"));
    }
    if (!resources_->assets->Has(asset.sha256())) {
      return absl::FailedPreconditionError(
          absl::StrCat("asset ", asset.sha256(), " (", name, ") is missing"));
    }
  }
  return absl::OkStatus();
}

absl::Status Submission::CheckAssetBytes(const v1::JobSpec& spec) const {
  // What lies here, not what the client says. A file that several names refer to counts once for each.
  const AssetStore& assets = *resources_->assets;
  uint64_t bytes = assets.SizeOf(spec.scene().file().sha256());
  for (const v1::AssetRef& asset : spec.scene().dependencies()) bytes += assets.SizeOf(asset.sha256());
  const uint64_t limit = resources_->options.limits.job_asset_bytes;
  if (bytes <= limit) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("the files of the scene have ", bytes, " bytes; the limit of a job is ", limit));
}

absl::Status Submission::BeginSubmission(const std::string& user) {
  const int limit = resources_->options.limits.jobs_per_user;
  FarmState::Change farm(state_);
  const int64_t jobs = farm->jobs.CountOf(user);
  if (farm->submissions.Begin(user, jobs, limit)) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("user ", logging::Quoted(user), " has ", jobs, " active jobs; the limit is ", limit));
}

absl::StatusOr<v1::SubmitJobResponse> Submission::SubmitJob(const v1::SubmitJobRequest& request) {
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
  if (absl::Status status = resources_->storage.status(); !status.ok()) return status;
  ledger::NewJob job{.id = {},
                     .request_id = request.request_id(),
                     .spec = *std::move(spec),
                     .scheduling = *std::move(scheduling),
                     .submitted = absl::InfinitePast(),
                     .owner = resources_->owner};
  // First: limits and conditions are those of new jobs. A client that did not get the answer to its
  // submission must get it by a repetition.
  const absl::StatusOr<std::optional<JobId>> recorded = resources_->store->FindRequest(job);
  if (!recorded.ok()) return resources_->NoteError(recorded.status());
  const absl::StatusOr<JobId> id =
      recorded->has_value() ? StartIfUncertain(**recorded) : SubmitNewJob(std::move(job));
  if (!id.ok()) return resources_->NoteError(id.status());
  v1::SubmitJobResponse response;
  response.set_job_id(id->value());
  return response;
}

absl::StatusOr<JobId> Submission::SubmitNewJob(ledger::NewJob job) {
  if (absl::Status status = cleanup_->janitor().CheckQuota(); !status.ok()) return status;
  if (absl::Status status = CheckSpec(job.spec); !status.ok()) return status;
  if (absl::Status status = CheckAssetBytes(job.spec); !status.ok()) return status;
  if (const std::string& webhook = job.scheduling.webhook(); !webhook.empty()) {
    if (absl::Status status = resources_->webhooks->Check(webhook); !status.ok()) return status;
  }
  const absl::StatusOr<std::vector<job::Prerequisite>> after = prerequisites_->Check(job.scheduling);
  if (!after.ok()) return after.status();
  const std::string user = job.scheduling.user();
  if (absl::Status status = BeginSubmission(user); !status.ok()) return status;
  job.submitted = resources_->options.wall_now();
  job.scheduling.set_turn_ms(absl::ToUnixMillis(job.submitted));
  job.id = job::MakeJobId(job.submitted, resources_->options.random());
  if (!rpc::IsTraceId(job.scheduling.trace_id()))
    job.scheduling.set_trace_id(rpc::MakeTraceId(resources_->options.random));
  absl::StatusOr<JobId> id = RecordJob(job, *after);
  FarmState::Change(state_)->submissions.End(user);
  return id;
}

absl::StatusOr<JobId> Submission::RecordJob(const ledger::NewJob& job,
                                            const std::vector<job::Prerequisite>& after) {
  const DataFolder& folder = resources_->folder;
  // First the manifest: a job that is in the ledger can be rebuilt from the folder.
  if (absl::Status status = WriteManifest(folder, ManifestOf(job)); !status.ok()) {
    cleanup_->DeleteFiles(folder.FilmPath(job.id));
    return status;
  }
  absl::StatusOr<JobId> id = resources_->store->CreateJob(job);
  if (IsStorageError(id.status())) {
    // It may be recorded: the manifest stays, and the job is started when the client, or the next start,
    // finds it.
    FarmState::Change(state_)->submissions.AddUncertain(job.id);
    return id;
  }
  if (!id.ok() || *id != job.id) cleanup_->DeleteFiles(folder.FilmPath(job.id));
  if (!id.ok()) return id;
  if (*id != job.id) return StartIfUncertain(*id);  // another call with the same request was faster
  ledger::JobRecord record;
  record.id = job.id;
  record.spec = job.spec;
  record.scheduling = job.scheduling;
  record.owner = job.owner;
  record.submitted = job.submitted;
  StartJob(std::move(record), after, /*was_uncertain=*/false);
  return id;
}

absl::StatusOr<JobId> Submission::StartIfUncertain(const JobId& id) {
  // Otherwise the job was started when it was recorded.
  if (!FarmState::View(state_)->submissions.IsUncertain(id)) return id;
  absl::StatusOr<ledger::JobRecord> recorded = resources_->store->GetJob(id);
  if (!recorded.ok()) return recorded.status();
  const absl::StatusOr<std::vector<job::Prerequisite>> after = prerequisites_->Read(recorded->scheduling);
  if (!after.ok()) return after.status();
  StartJob(*std::move(recorded), *after, /*was_uncertain=*/true);
  return id;
}

void Submission::StartJob(ledger::JobRecord record, const std::vector<job::Prerequisite>& after,
                          bool was_uncertain) {
  resources_->LabelJob(record.id, record.scheduling);
  {
    FarmState::Change farm(state_);
    // Another call may have started it, and it may have ended since.
    if (was_uncertain && !farm->submissions.Forget(record.id)) return;
    farm->StartJob(std::move(record), after);
  }
  prerequisites_->LookAgain(after);
}

void Submission::StartUncertainJobs() {
  const std::set<JobId> jobs = FarmState::View(state_)->submissions.uncertain();
  for (const JobId& job : jobs) {
    const absl::StatusOr<JobId> started = StartIfUncertain(job);
    // It was not recorded; the client submits it again, perhaps elsewhere.
    if (absl::IsNotFound(started.status())) FarmState::Change(state_)->submissions.Forget(job);
  }
}

}  // namespace lumifold::server
