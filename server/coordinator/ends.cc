// How jobs end: at once for workers, and for clients once the end is recorded.
#include <spdlog/logger.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "server/coordinator/coordinator.h"
#include "server/coordinator/job_status.h"
#include "server/job/job_state.h"

namespace lumifold::server {

using job::JobId;

namespace {

/// Rows of units that are deleted in one transaction: a few milliseconds in which others cannot write.
constexpr int64_t kPurgedRows = 1000;

}  // namespace

void Coordinator::EndJob(const JobId& job, v1::JobState state, const std::string& cause) {
  const auto active = active_jobs_.find(job);
  if (active == active_jobs_.end()) return;
  const std::string error = rpc::BoundedLine(cause, rpc::kMaxErrorBytes);
  EndingJob ending{.record = std::move(active->second), .shown = {}, .cancels = {}};
  if (scheduler_.HasJob(job)) {
    const scheduler::JobProgress progress = scheduler_.Progress(job);
    ending.shown = StatusOfActiveJob(ending.record, progress);
    // All frames may be finished, but the job is done when that is recorded.
    if (job::HasEnded(ending.shown.state())) ending.shown.set_state(v1::JOB_STATE_FILTERING);
    ending.record.units_done = progress.units_done;
    ending.record.samples_done = progress.samples_done;
    ending.record.frames_done = progress.frames_done;
  } else {  // its spec is not valid
    ending.shown = StatusOfEndedJob(ending.record);
  }
  ending.shown.set_workers(0);
  ending.record.state = state;
  ending.record.error = error;
  active_jobs_.erase(active);
  ending_jobs_.emplace(job, std::move(ending));
  StopRendering(job);
  committer_->Write([this, job, state, error] { return RecordEnd(job, state, error); },
                    [this, job](const absl::Status& status) { OnEndRecorded(job, status); });
  options_.log->info("event=job_ended job={} state={} error={}", job.value(), v1::JobState_Name(state),
                     logging::Quoted(error));
  GrantLeases();
}

void Coordinator::StopRendering(const JobId& job) {
  scheduler_.EndJob(job);
  wanted_assets_.erase(job);
  render_starts_.erase(job);
  unit_bytes_.erase(job);
  predicted_errors_.erase(job);
  scene_files_.erase(job);
  std::erase_if(committed_frames_, [&job](const CommittedFrame& frame) { return frame.job == job; });
  finisher_->CancelJob(job);
  std::erase_if(losses_, [&job](const auto& entry) { return entry.first.first == job; });
  v1::CoordinatorMessage message;
  message.mutable_job_ended()->set_job_id(job.value());
  for (auto& [id, worker] : workers_) {
    if (worker.known_jobs.erase(job) > 0) worker.sink->Send(message);
  }
}

absl::Status Coordinator::RecordEnd(const JobId& job, v1::JobState state, const std::string& error) {
  absl::Status status = store_->EndJob(Owned(job), state, error);
  // Whoever waits is told now; the order stays and is carried out when the storage can be written.
  if (IsStorageError(status)) {
    AnswerCancels(
        job, absl::ResourceExhaustedError(absl::StrCat(
                 "the job is stopped, but that cannot be recorded yet: ", std::string(status.message()))));
  }
  return status;
}

void Coordinator::OnEndRecorded(const JobId& job, const absl::Status& status) {
  committer_->ForgetLogs(job);
  // Who asked for an end that another coordinator's job did not get asks again, and is led to that one.
  const absl::Status lost = absl::IsAborted(status) ? absl::UnavailableError(status.message()) : status;
  EndingJob ended;
  {
    absl::MutexLock lock(&mutex_);
    ended = std::move(ending_jobs_.extract(job).mapped());
    for (const auto& [watcher, watched] : watchers_) {
      if (watched != job) continue;
      if (status.ok()) {
        watcher->OnStatus(StatusOfEndedJob(ended.record));
      } else {
        watcher->OnLost(lost);
      }
    }
    if (status.ok()) Settle(dependencies_.Ended(job, ended.record.state));
  }
  for (const StatusAnswer& done : ended.cancels)
    done(status.ok() ? absl::StatusOr<v1::JobStatus>(StatusOfEndedJob(ended.record)) : lost);
  if (!status.ok()) {
    // Another coordinator has the job, or its row is gone: what lies here is not this coordinator's to delete.
    options_.log->error("event=ledger_failed job={} error={}", job.value(),
                        logging::Quoted(std::string(status.message())));
    return;
  }
  janitor_.JobEnded(job, ended.record.state, ended.record.error);
  PurgeUnits();
}

void Coordinator::AnswerCancels(const JobId& job, const absl::StatusOr<v1::JobStatus>& answer) {
  std::vector<StatusAnswer> cancels;
  {
    absl::MutexLock lock(&mutex_);
    const auto ending = ending_jobs_.find(job);
    if (ending != ending_jobs_.end()) cancels = std::exchange(ending->second.cancels, {});
  }
  for (const StatusAnswer& done : cancels) done(answer);
}

void Coordinator::CancelJob(const std::string& job_id, StatusAnswer done) {
  const JobId job(job_id);
  bool is_stopping = false;
  bool is_suspended = false;
  {
    absl::MutexLock lock(&mutex_);
    is_suspended = suspended_jobs_.contains(job);
    EndJob(job, v1::JOB_STATE_CANCELLED, "");
    const auto ending = ending_jobs_.find(job);
    is_stopping = ending != ending_jobs_.end() && !leasing_;
    if (ending != ending_jobs_.end() && leasing_) {
      ending->second.cancels.push_back(std::move(done));
      return;
    }
  }
  if (is_stopping) return done(absl::UnavailableError("the coordinator is stopping"));
  if (is_suspended) {  // after the change
    return Change([this, job] { return CancelNow(job); }, std::move(done));
  }
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  const absl::Status ended = status.ok() ? CheckHasEnded(*status) : absl::OkStatus();
  done(ended.ok() ? status : ended);
}

void Coordinator::DeleteFiles(const std::string& path) {
  deleter_.Run([this, path] {
    const absl::Status removed = RemoveAll(path, folder_.files());
    if (!removed.ok()) {  // it only takes space until the next start
      options_.log->warn("event=not_deleted error={}", logging::Quoted(std::string(removed.message())));
    }
  });
}

void Coordinator::PurgeUnits() {
  if (purging_.exchange(true)) return;
  purger_.Run([this] {
    purging_ = false;
    const absl::StatusOr<int64_t> left = store_->PurgeUnits(kPurgedRows);
    // Rows that stay only take space until the next job ends.
    if (left.ok() && *left > 0) PurgeUnits();
  });
}

}  // namespace lumifold::server
