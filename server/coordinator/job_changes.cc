#include "server/coordinator/job_changes.h"

#include <spdlog/logger.h>

#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "proto/rpc/rect_codec.h"
#include "server/commit/revise_film.h"
#include "server/job/frame_list.h"
#include "server/job/gaps.h"
#include "server/job/job_state.h"
#include "server/storage/manifest.h"

namespace lumifold::server {

using job::JobId;
using job::ReopenPlan;
using job::ReopenRequest;

namespace {

/// Pause before a job that cannot be read is read again.
constexpr absl::Duration kReadPause = absl::Seconds(1);

}  // namespace

void JobChanges::CancelJob(const std::string& job_id, StatusAnswer done) {
  const JobId job(job_id);
  bool is_stopping = false;
  bool is_suspended = false;
  {
    FarmState::Change farm(state_);
    is_suspended = farm->jobs.FindSuspended(job) != nullptr;
    farm->EndJob(job, v1::JOB_STATE_CANCELLED, "");
    EndingJob* const ending = farm->jobs.FindEnding(job);
    is_stopping = ending != nullptr && !farm->is_leasing();
    if (ending != nullptr && farm->is_leasing()) {
      ending->cancels.push_back(std::move(done));
      return;
    }
  }
  if (is_stopping) return done(absl::UnavailableError("the coordinator is stopping"));
  if (is_suspended) {  // after the change
    return Change([this, job] { return CancelNow(job); }, std::move(done));
  }
  const absl::StatusOr<v1::JobStatus> status = parts_.queries->StatusOf(job);
  const absl::Status ended = status.ok() ? JobQueries::CheckHasEnded(*status) : absl::OkStatus();
  done(ended.ok() ? status : ended);
}

void JobChanges::RetryJob(const v1::RetryJobRequest& request, StatusAnswer done) {
  ReopenRequest wanted{.frames = {request.frames().begin(), request.frames().end()},
                       .filter_only = request.filter_only(),
                       .skip = request.skip()};
  if (request.has_region()) wanted.region = rpc::RectOf(request.region());
  Change([this, job = JobId(request.job_id()), wanted] { return Reopen(job, wanted); }, std::move(done));
}

void JobChanges::AddSamples(const v1::AddSamplesRequest& request, StatusAnswer done) {
  const ReopenRequest wanted{.samples_per_pixel = request.samples_per_pixel()};
  Change([this, job = JobId(request.job_id()), wanted] { return Reopen(job, wanted); }, std::move(done));
}

void JobChanges::DeleteJob(const v1::DeleteJobRequest& request, StatusAnswer done) {
  Change([this, job = JobId(request.job_id())] { return Delete(job); }, std::move(done));
}

void JobChanges::SkipFrame(const FrameKey& frame, const std::string& cause) {
  const auto& [job, number] = frame;
  const ReopenRequest wanted{.frames = {number}, .skip = true};
  Queue([this, job = job, wanted] { return Reopen(job, wanted); },
        [this, frame, cause](const absl::StatusOr<v1::JobStatus>& answer) {
          if (answer.ok()) return;
          FarmState::Change farm(state_);
          if (absl::IsInvalidArgument(answer.status())) return farm->FailJob(frame.first, cause);
          ActiveJob* const active = farm->jobs.FindActive(frame.first);
          if (active == nullptr) return;
          active->skipping.erase(frame.second);  // it is tried again
          farm->QueueDue(frame);
        });
}

void JobChanges::Change(Work work, StatusAnswer done) {
  if (!Queue(std::move(work), done)) done(absl::UnavailableError("the coordinator is stopping"));
}

bool JobChanges::Queue(Work work, const StatusAnswer& done) {
  int64_t number = 0;
  {
    absl::MutexLock lock(&mutex_);
    if (!is_open_) return false;
    number = next_change_++;
    answers_.emplace(number, done);
  }
  thread_.Run([this, number, work = std::move(work)] {
    const absl::Status storage = resources_->storage.status();
    Answer(number, storage.ok() ? work() : storage);
  });
  return true;
}

void JobChanges::Answer(int64_t number, const absl::StatusOr<v1::JobStatus>& answer) {
  StatusAnswer done;
  {
    absl::MutexLock lock(&mutex_);
    auto waiting = answers_.extract(number);
    if (waiting.empty()) return;  // StopAnswering has answered
    done = std::move(waiting.mapped());
  }
  done(answer.ok() ? answer : resources_->NoteError(answer.status()));
}

void JobChanges::StopAnswering() {
  std::map<int64_t, StatusAnswer> answers;
  {
    absl::MutexLock lock(&mutex_);
    is_open_ = false;
    answers = std::exchange(answers_, {});
  }
  for (const auto& [number, done] : answers)
    done(absl::UnavailableError("the coordinator is stopping; the job may not be changed yet"));
}

void JobChanges::Stop() {
  stopping_.Notify();
  thread_.Stop();
}

absl::StatusOr<ReopenPlan> JobChanges::PlanFor(const JobId& job, const ReopenRequest& request) {
  const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  absl::StatusOr<std::vector<int32_t>> finished = resources_->store->FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  job::ReopenedJob reopened{.spec = record->spec,
                            .state = record->state,
                            .frames = {},
                            .finished = *std::move(finished),
                            .gaps = record->scheduling.gaps()};
  const job::FrameList frames(record->spec);
  for (int i = 0; i < frames.count(); ++i) reopened.frames.push_back(frames.NumberOf(i));
  return ReopenPlan::Make(reopened, request);
}

absl::StatusOr<v1::JobStatus> JobChanges::Reopen(const JobId& job, const ReopenRequest& request) {
  AwaitEnd(job);
  absl::StatusOr<v1::JobStatus> before = parts_.queries->StatusOf(job);
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
  return parts_.queries->StatusOf(job);
}

void JobChanges::AwaitEnd(const JobId& job) {
  state_->Await([&](const Farm& farm) { return farm.jobs.FindEnding(job) == nullptr; });
}

absl::Status JobChanges::Suspend(const JobId& job, v1::JobStatus shown) {
  AwaitEnd(job);
  FarmState::Change(state_)->SuspendJob(job, std::move(shown));
  state_->Await([&](const Farm& farm) { return !farm.frames.IsFinishing(job); });
  parts_.committer->Write([] { return absl::OkStatus(); },
                          [this, job](const absl::Status&) {
                            parts_.committer->ForgetJob(job);
                            FarmState::Change(state_)->jobs.FindSuspended(job)->committer_is_done = true;
                          });
  const bool is_suspended =
      state_->Await([&](const Farm& farm) { return farm.jobs.FindSuspended(job)->committer_is_done; });
  return is_suspended ? absl::OkStatus() : absl::UnavailableError("the coordinator is stopping");
}

absl::Status JobChanges::ChangeFiles(const JobId& job, const ReopenPlan& plan) {
  const DataFolder& folder = resources_->folder;
  parts_.cleanup->janitor().Keep(job);
  const absl::StatusOr<std::vector<int32_t>> without_film = ReviseFilm(folder, job, plan, folder.files());
  if (!without_film.ok()) return without_film.status();
  absl::MutexLock one_change(parts_.scheduling);
  absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
  if (!record.ok()) return record.status();
  resources_->LabelJob(job, record->scheduling);
  record->spec = plan.spec();
  *record->scheduling.mutable_gaps() = plan.gaps();
  if (absl::Status status = UnretireJob(folder, *record); !status.ok()) return status;
  const ledger::Reopening reopening = {.spec = plan.spec(),
                                       .scheduling = record->scheduling,
                                       .frames = plan.forgotten_frames(),
                                       .counted = FarmState::Change(state_)->scheduler.NextAttempt()};
  if (absl::Status status = resources_->store->ReopenFrames(job, resources_->owner, reopening); !status.ok())
    return status;
  resources_->log().info(
      "event=job_reopened job={} spp={} frames={} frames_without_film={} frames_skipped={}", job.value(),
      plan.spec().samples_per_pixel(), plan.frames().size(), without_film->size(),
      job::CountSkipped(plan.gaps()));
  return absl::OkStatus();
}

void JobChanges::Resume(const JobId& job) {
  absl::StatusOr<std::optional<LoadedJob>> loaded = parts_.loader->Load(job);
  while (IsStorageError(loaded.status())) {
    resources_->storage.Fail(loaded.status());
    if (stopping_.WaitFor(kReadPause)) return;  // the next start restores it
    loaded = parts_.loader->Load(job);
  }
  if (!loaded.ok() || !loaded->has_value()) {  // nothing was changed
    FarmState::Change(state_)->jobs.EndSuspension(job);
    return;
  }
  const std::vector<job::Prerequisite> after = (**loaded).after;
  const auto shared = std::make_shared<LoadedJob>(**std::move(loaded));
  parts_.committer->Write([] { return absl::OkStatus(); },
                          [this, job, shared](const absl::Status&) {
                            for (const auto& [frame, bytes] : shared->committed_bytes)
                              parts_.committer->RestoreLog({job, frame}, bytes);
                            FarmState::Change farm(state_);
                            farm->jobs.EndSuspension(job);
                            farm->EnterJob(*shared);
                            farm->dependencies.Reopened(job);
                          });
  state_->Await([&](const Farm& farm) { return farm.jobs.FindSuspended(job) == nullptr; });
  parts_.loader->prerequisites().LookAgain(after);
}

absl::StatusOr<v1::JobStatus> JobChanges::Delete(const JobId& job) {
  AwaitEnd(job);
  absl::StatusOr<v1::JobStatus> status = parts_.queries->StatusOf(job);
  if (!status.ok()) return status;
  resources_->LabelJob(job, status->scheduling());
  if (FarmState::View(state_)->jobs.FindActive(job) != nullptr)
    return absl::FailedPreconditionError(
        absl::StrCat("job ", job.value(), " has not ended; cancel it first"));
  absl::Status deleted = parts_.cleanup->janitor().Delete(job);
  if (!deleted.ok()) {
    const absl::StatusOr<ledger::JobRecord> record = resources_->store->GetJob(job);
    if (record.ok() && job::HasEnded(record->state))
      parts_.cleanup->janitor().JobEnded(job, record->state, record->error);
    return deleted;
  }
  resources_->log().info("event=job_deleted job={} cause=\"asked for\"", job.value());
  FarmState::Change farm(state_);
  farm->Settle(farm->dependencies.Deleted(job));
  return status;
}

absl::StatusOr<v1::JobStatus> JobChanges::CancelNow(const JobId& job) {
  FarmState::Change(state_)->EndJob(job, v1::JOB_STATE_CANCELLED, "");
  AwaitEnd(job);
  return parts_.queries->StatusOf(job);
}

}  // namespace lumifold::server
