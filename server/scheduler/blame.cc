// Who is to blame for a failed unit: the job, if a second worker agrees, or the worker, if another one
// renders the unit.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::UnitRef;
using job::WorkerId;

FailureOutcome Scheduler::FailUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, bool permanent,
                                   absl::Time now) {
  if (FindLease(worker, unit, attempt) == nullptr) return FailureOutcome::kIgnored;
  const UnitIndex index = leases_.Remove(attempt).unit;
  const std::string name = workers_.Find(worker)->name;
  Job& job = jobs_.at(index.job);
  History& history = job.history[index.place];
  ++history.failures;
  history.last_failed = worker;
  history.failed_workers.insert(worker);
  if (permanent) history.permanent_by.insert(name);
  ReleaseSlot(worker);
  const bool first_opinion = permanent && history.permanent_by.size() == 1;
  if (MayReturn(index)) {
    const absl::Duration backoff =
        std::min(options_.first_backoff * (int64_t{1} << std::min(history.failures - 1, 30)),
                 options_.longest_backoff);
    ReturnAfter(index, first_opinion ? absl::ZeroDuration() : backoff, now);
  }
  const bool agreed = history.permanent_by.size() >= 2;
  const bool unopposed = permanent && !workers_.HasOther(worker, job.numeric_class);
  return agreed || unopposed || history.failures >= options_.max_failures ? FailureOutcome::kJobFails
                                                                          : FailureOutcome::kRetried;
}

void Scheduler::ReturnAfter(const UnitIndex& index, absl::Duration backoff, absl::Time now) {
  if (backoff > absl::ZeroDuration()) {
    delayed_.emplace(now + backoff, index);
  } else {
    Return(index);
  }
}

void Scheduler::ReturnDelayed(absl::Time now) {
  while (!delayed_.empty() && delayed_.begin()->first <= now) {
    const UnitIndex index = delayed_.begin()->second;
    delayed_.erase(delayed_.begin());
    const auto job = jobs_.find(index.job);
    if (job == jobs_.end()) continue;
    const auto frame = job->second.frames.find(index.place.frame);  // gone once it is finished
    if (frame == job->second.frames.end() || frame->second.taken[static_cast<size_t>(index.place.number)])
      continue;
    if (MayReturn(index)) Return(index);
  }
}

void Scheduler::BlameOthers(const UnitIndex& index, WorkerId worker, absl::Time now) {
  const Job& job = jobs_.at(index.job);
  const auto history = job.history.find(index.place);
  if (history == job.history.end()) return;
  for (const WorkerId failed : history->second.failed_workers) {
    if (failed != worker) Blame(failed, index.job, now);
  }
}

void Scheduler::Blame(WorkerId worker, int64_t job, absl::Time now) {
  const Worker* state = workers_.Find(worker);
  if (state == nullptr || state->set_aside_until != absl::InfinitePast()) return;
  std::map<int64_t, absl::Time>& jobs = workers_.BlamedJobs(worker);
  std::erase_if(jobs, [&](const auto& entry) { return entry.second + options_.set_aside <= now; });
  jobs[job] = now;
  if (static_cast<int>(jobs.size()) < options_.max_blamed_jobs) return;
  // A fault that all workers share, such as of the network, must not empty the farm.
  const std::string& numeric_class = state->numeric_class;
  if (workers_.SetAsideCount(numeric_class) + 1 >= workers_.AvailableCount(numeric_class)) return;
  const absl::Time until = now + options_.set_aside;
  workers_.SetAside(worker, until);
  newly_set_aside_.push_back({worker, until, SetAsideReason(worker)});
}

std::vector<SetAsideWorker> Scheduler::TakeSetAside() { return std::exchange(newly_set_aside_, {}); }

std::string Scheduler::SetAsideReason(WorkerId worker) const {
  const Worker* state = workers_.Find(worker);
  if (state == nullptr || state->set_aside_until == absl::InfinitePast()) return "";
  return absl::StrCat("it failed units of ", state->blamed_jobs.size(), " jobs that other workers rendered");
}

void Scheduler::Readmit(absl::Time now) {
  for (const WorkerId worker : workers_.Readmissible(now)) {
    workers_.SetAside(worker, absl::InfinitePast());
    workers_.BlamedJobs(worker).clear();
  }
}

}  // namespace lumifold::scheduler
