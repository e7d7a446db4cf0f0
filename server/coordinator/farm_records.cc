#include "server/coordinator/farm_records.h"

#include <spdlog/logger.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/retry/storage_away.h"
#include "server/commit/committer.h"
#include "server/coordinator/job_changes.h"
#include "server/coordinator/job_status.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {

using job::JobId;

void FarmRecords::RecordEnd(const JobId& job, v1::JobState state, const std::string& error) {
  committer_->Write([this, job, state, error] { return WriteEnd(job, state, error); },
                    [this, job](const absl::Status& status) { OnEndRecorded(job, status); });
}

absl::Status FarmRecords::WriteFailedFrame(const JobId& job) {
  v1::Scheduling scheduling;
  {
    FarmState::View farm(state_);
    if (const EndingJob* const ending = farm->jobs.FindEnding(job); ending != nullptr)
      scheduling = ending->record.scheduling;
  }
  if (!scheduling.gaps().has_failed_frame()) return absl::OkStatus();
  absl::Status status = resources_->store->SetScheduling(resources_->Owned(job), scheduling);
  return absl::IsFailedPrecondition(status) ? absl::OkStatus() : status;  // an earlier try has ended it
}

std::optional<ledger::NewDelivery> FarmRecords::WebhookOf(const JobId& job) {
  v1::JobStatus ended;
  {
    FarmState::View farm(state_);
    if (const EndingJob* const ending = farm->jobs.FindEnding(job); ending != nullptr)
      ended = StatusOfEndedJob(ending->record);
  }
  return resources_->webhooks->DeliveryOf(ended);
}

absl::Status FarmRecords::WriteEnd(const JobId& job, v1::JobState state, const std::string& error) {
  absl::Status status = WriteFailedFrame(job);
  if (status.ok()) status = resources_->store->EndJob(resources_->Owned(job), {state, error, WebhookOf(job)});
  // Whoever waits is told now; the order stays and is carried out when the storage can be written.
  if (IsStorageError(status)) {
    AnswerCancels(job,
                  absl::UnavailableError(absl::StrCat("the job is stopped, but that cannot be recorded yet: ",
                                                      std::string(retry::StorageAway(status).message()))));
  }
  return status;
}

void FarmRecords::OnEndRecorded(const JobId& job, const absl::Status& status) {
  committer_->ForgetLogs(job);
  // The job belongs to another coordinator: a client that asks again reaches that one.
  const absl::Status lost = absl::IsAborted(status) ? absl::UnavailableError(status.message()) : status;
  EndingJob ended;
  absl::StatusOr<v1::JobStatus> last;
  {
    FarmState::Change farm(state_);
    ended = farm->jobs.TakeEnding(job);
    last = status.ok() ? absl::StatusOr<v1::JobStatus>(StatusOfEndedJob(ended.record)) : lost;
    farm->watchers.NotifyEnd(job, last);
    if (status.ok()) farm->Settle(farm->dependencies.Ended(job, ended.record.state));
  }
  for (const StatusAnswer& done : ended.cancels) done(last);
  if (!status.ok()) {
    // Another coordinator has the job, or its row is gone: what lies here is not this coordinator's to
    // delete.
    resources_->log().error("event=ledger_failed job={} error={}", job.value(),
                            logging::Quoted(status.message()));
    return;
  }
  if (!ended.record.scheduling.webhook().empty()) resources_->webhooks->Wake();
  cleanup_->janitor().JobEnded(job, ended.record.state, ended.record.error);
  cleanup_->PurgeUnits();
}

void FarmRecords::AnswerCancels(const JobId& job, const absl::StatusOr<v1::JobStatus>& answer) {
  std::vector<StatusAnswer> cancels;
  {
    FarmState::Change farm(state_);
    if (EndingJob* const ending = farm->jobs.FindEnding(job); ending != nullptr)
      cancels = std::exchange(ending->cancels, {});
  }
  for (const StatusAnswer& done : cancels) done(answer);
}

void FarmRecords::CancelFinishing(const JobId& job) { resources_->finisher->CancelJob(job); }

void FarmRecords::DiscardUnits(const FrameKey& frame, const std::vector<job::UnitKey>& units) {
  committer_->Discard(frame, units);
}

void FarmRecords::RecordBlock(const std::string& name, const std::string& reason) {
  committer_->Write([this, name, reason] { return resources_->store->BlockWorker(name, reason); },
                    [this, name](const absl::Status& status) {
                      if (status.ok()) return;
                      resources_->log().error("event=ledger_failed worker={} error={}",
                                              absl::StrCat("-/", name), logging::Quoted(status.message()));
                    });
}

void FarmRecords::SkipFrame(const FrameKey& frame, const std::string& cause) {
  changes_->SkipFrame(frame, cause);
}

void FarmRecords::KeepPrerequisites(const std::set<JobId>& jobs) { cleanup_->janitor().SetNeeded(jobs); }

}  // namespace lumifold::server
