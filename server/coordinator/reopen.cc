// Changes of jobs that exist: parts are rendered again, samples are added, or the job is deleted.
//
// A job that is changed is first suspended: it leaves the scheduler, the finisher and the committer, as if it had ended.
// Then its logs and its row are changed, and it is restored as after a restart. A crash at any point leaves the job as it
// was before or after the change, or with some units that are rendered again.
#include <spdlog/logger.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/rect_codec.h"
#include "server/commit/revise_film.h"
#include "server/coordinator/coordinator.h"
#include "server/job/frame_list.h"
#include "server/job/job_state.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;
using job::ReopenPlan;
using job::ReopenRequest;

namespace {

/// Pause before a job that cannot be read is read again.
constexpr absl::Duration kReopenPause = absl::Seconds(1);

}  // namespace

void Coordinator::RetryJob(const v1::RetryJobRequest& request, StatusAnswer done) {
  ReopenRequest wanted{.frames = {request.frames().begin(), request.frames().end()},
                       .filter_only = request.filter_only()};
  if (request.has_region()) wanted.region = rpc::RectOf(request.region());
  Change([this, job = JobId(request.job_id()), wanted] { return Reopen(job, wanted); }, std::move(done));
}

void Coordinator::AddSamples(const v1::AddSamplesRequest& request, StatusAnswer done) {
  const ReopenRequest wanted{.samples_per_pixel = request.samples_per_pixel()};
  Change([this, job = JobId(request.job_id()), wanted] { return Reopen(job, wanted); }, std::move(done));
}

void Coordinator::DeleteJob(const v1::DeleteJobRequest& request, StatusAnswer done) {
  Change([this, job = JobId(request.job_id())] { return Delete(job); }, std::move(done));
}

void Coordinator::Change(std::function<absl::StatusOr<v1::JobStatus>()> change, StatusAnswer done) {
  int64_t number = 0;
  bool is_stopping = false;
  {
    absl::MutexLock lock(&mutex_);
    is_stopping = !leasing_;
    number = next_change_++;
    if (!is_stopping) changes_.emplace(number, done);
  }
  if (is_stopping) return done(absl::UnavailableError("the coordinator is stopping"));
  changer_.Run([this, number, change = std::move(change)] {
    const absl::Status storage = storage_.status();
    AnswerChange(number, storage.ok() ? change() : storage);
  });
}

void Coordinator::AnswerChange(int64_t number, const absl::StatusOr<v1::JobStatus>& answer) {
  StatusAnswer done;
  {
    absl::MutexLock lock(&mutex_);
    const auto waiting = changes_.find(number);
    if (waiting == changes_.end()) return;  // StopLeasing has answered
    done = std::move(waiting->second);
    changes_.erase(waiting);
  }
  done(answer.ok() ? answer : NoteError(answer.status()));
}

absl::StatusOr<ReopenPlan> Coordinator::PlanFor(const JobId& job, const ReopenRequest& request) {
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  absl::StatusOr<std::vector<int32_t>> finished = store_->FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  job::ReopenedJob reopened{
      .spec = record->spec, .state = record->state, .frames = {}, .finished = *std::move(finished)};
  const job::FrameList frames(record->spec);
  for (int i = 0; i < frames.count(); ++i) reopened.frames.push_back(frames.NumberOf(i));
  return ReopenPlan::Make(reopened, request);
}

absl::StatusOr<v1::JobStatus> Coordinator::Reopen(const JobId& job, const ReopenRequest& request) {
  AwaitEnd(job);
  absl::StatusOr<v1::JobStatus> before = StatusOf(job);
  if (!before.ok()) return before;
  // What cannot be done is refused before anything is stopped.
  absl::StatusOr<ReopenPlan> plan = PlanFor(job, request);
  if (!plan.ok()) return plan.status();
  if (plan->ChangesNothing()) return before;
  if (absl::Status status = Suspend(job, *std::move(before)); !status.ok()) return status;
  plan = PlanFor(job, request);  // frames may have been finished meanwhile
  const absl::Status changed = plan.ok() ? ChangeFiles(job, *plan) : plan.status();
  Resume(job);
  if (!changed.ok()) return changed;
  return StatusOf(job);
}

void Coordinator::AwaitEnd(const JobId& job) {
  const auto has_ended = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    return stopping_ || !ending_jobs_.contains(job);
  };
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(&has_ended));
}

absl::Status Coordinator::Suspend(const JobId& job, v1::JobStatus shown) {
  AwaitEnd(job);
  {
    absl::MutexLock lock(&mutex_);
    SuspendedJob suspended{.shown = std::move(shown)};
    if (const auto active = active_jobs_.find(job); active != active_jobs_.end()) {
      suspended.shown = *StatusInMemory(job);
      suspended.shown.set_workers(0);
      active_jobs_.erase(active);
      dependencies_.Remove(job);
      StopRendering(job);
      GrantLeases();
    }
    suspended_jobs_[job] = std::move(suspended);
    const auto is_not_finishing = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
      return stopping_ || !finished_frame_.has_value() || finished_frame_->first != job;
    };
    mutex_.Await(absl::Condition(&is_not_finishing));
  }
  committer_->Write([] { return absl::OkStatus(); },
                    [this, job](const absl::Status&) {
                      committer_->ForgetJob(job);
                      absl::MutexLock lock(&mutex_);
                      suspended_jobs_.at(job).committer_is_done = true;
                    });
  absl::MutexLock lock(&mutex_);
  const auto is_suspended = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    return stopping_ || suspended_jobs_.at(job).committer_is_done;
  };
  mutex_.Await(absl::Condition(&is_suspended));
  return stopping_ ? absl::UnavailableError("the coordinator is stopping") : absl::OkStatus();
}

absl::Status Coordinator::ChangeFiles(const JobId& job, const ReopenPlan& plan) {
  janitor_.Keep(job);
  const absl::StatusOr<std::vector<int32_t>> without_film = ReviseFilm(folder_, job, plan, folder_.files());
  if (!without_film.ok()) return without_film.status();
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  LabelJob(job, record->scheduling);
  if (absl::Status status = UnretireJob(folder_, *record, plan.spec()); !status.ok()) return status;
  if (absl::Status status = store_->ReopenFrames(job, owner_, plan.spec(), plan.frames()); !status.ok())
    return status;
  options_.log->info("event=job_reopened job={} spp={} frames={} frames_without_film={}", job.value(),
                     plan.spec().samples_per_pixel(), plan.frames().size(), without_film->size());
  return absl::OkStatus();
}

absl::StatusOr<std::optional<Coordinator::LoadedJob>> Coordinator::LoadSuspended(const JobId& job) {
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  if (job::HasEnded(record->state)) {  // nothing was changed
    janitor_.JobEnded(job, record->state, record->error);
    return std::nullopt;
  }
  absl::StatusOr<LoadedJob> loaded = LoadJob(*record);
  if (!loaded.ok()) return loaded.status();
  return *std::move(loaded);
}

void Coordinator::Resume(const JobId& job) {
  absl::StatusOr<std::optional<LoadedJob>> loaded = LoadSuspended(job);
  while (IsStorageError(loaded.status())) {
    storage_.Fail(loaded.status());
    changing_.Consume(kReopenPause);
    {
      absl::MutexLock lock(&mutex_);
      if (stopping_) return;  // the next start restores it
    }
    loaded = LoadSuspended(job);
  }
  if (!loaded.ok() || !loaded->has_value()) {
    absl::MutexLock lock(&mutex_);
    suspended_jobs_.erase(job);
    return;
  }
  const std::vector<job::Prerequisite> after = (**loaded).after;
  const auto shared = std::make_shared<LoadedJob>(**std::move(loaded));
  committer_->Write([] { return absl::OkStatus(); },
                    [this, job, shared](const absl::Status&) {
                      for (const auto& [frame, bytes] : shared->committed_bytes)
                        committer_->RestoreLog({job, frame}, bytes);
                      absl::MutexLock lock(&mutex_);
                      suspended_jobs_.erase(job);
                      EnterJob(*shared);
                      dependencies_.Reopened(job);
                      changed_jobs_.insert(job);
                      housekeeping_.Notify();
                      GrantLeases();
                    });
  {
    absl::MutexLock lock(&mutex_);
    const auto is_resumed = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
      return stopping_ || !suspended_jobs_.contains(job);
    };
    mutex_.Await(absl::Condition(&is_resumed));
  }
  CheckPrerequisites(after);
}

absl::StatusOr<v1::JobStatus> Coordinator::Delete(const JobId& job) {
  AwaitEnd(job);
  absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status;
  LabelJob(job, status->scheduling());
  {
    absl::MutexLock lock(&mutex_);
    if (active_jobs_.contains(job))
      return absl::FailedPreconditionError(
          absl::StrCat("job ", job.value(), " has not ended; cancel it first"));
  }
  absl::Status deleted = janitor_.Delete(job);
  if (!deleted.ok()) {
    const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
    if (record.ok() && job::HasEnded(record->state)) janitor_.JobEnded(job, record->state, record->error);
    return deleted;
  }
  options_.log->info("event=job_deleted job={} cause=\"asked for\"", job.value());
  absl::MutexLock lock(&mutex_);
  Settle(dependencies_.Deleted(job));
  return status;
}

absl::StatusOr<v1::JobStatus> Coordinator::CancelNow(const JobId& job) {
  {
    absl::MutexLock lock(&mutex_);
    EndJob(job, v1::JOB_STATE_CANCELLED, "");
  }
  AwaitEnd(job);
  return StatusOf(job);
}

}  // namespace lumifold::server
