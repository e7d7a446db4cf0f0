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
  latest_ = std::max(latest_, now);
  if (FindLease(worker, unit, attempt) == nullptr) return FailureOutcome::kIgnored;
  const Lease lease = RemoveLease(attempt);
  const UnitIndex index = lease.unit;
  const std::string name = workers_.Find(worker)->traits.name;
  if (lease.audit) {
    DeclineAudit(index, worker);
    ReleaseSlot(worker);
    return FailureOutcome::kRetried;
  }
  Job& job = jobs_.at(index.job);
  History& history = job.history[index.place];
  ++history.failures;
  history.last_failed = name;
  history.failed_workers.insert(worker);
  if (permanent) history.permanent_by.insert(name);
  workers_.Change(worker, [](Worker& state) { ++state.units_failed; });
  ReleaseSlot(worker);
  const bool first_opinion = permanent && history.permanent_by.size() == 1;
  if (MayReturn(index)) {
    const absl::Duration backoff =
        std::min(options_.first_backoff * (int64_t{1} << std::min(history.failures - 1, 30)),
                 options_.longest_backoff);
    ReturnAfter(index, first_opinion ? absl::ZeroDuration() : backoff, now);
    ++retries_[RetryReason::kFailed];
  }
  const bool agreed = history.permanent_by.size() >= 2;
  const bool unopposed = permanent && !workers_.HasOther(worker, RequirementOf(job));
  return agreed || unopposed || history.failures >= options_.max_failures ? FailureOutcome::kJobFails
                                                                          : FailureOutcome::kRetried;
}

void Scheduler::ReturnAfter(const UnitIndex& index, absl::Duration backoff, absl::Time now) {
  if (backoff > absl::ZeroDuration()) {
    delayed_.emplace(now + backoff, index);
    jobs_.at(index.job).delayed[index.place] = now + backoff;
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
    job->second.delayed.erase(index.place);
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
  int blamed_jobs = 0;
  workers_.Change(worker, [&](Worker& changed) {
    std::map<int64_t, absl::Time>& jobs = changed.blamed_jobs;
    std::erase_if(jobs, [&](const auto& entry) { return entry.second + options_.set_aside <= now; });
    jobs[job] = now;
    blamed_jobs = static_cast<int>(jobs.size());
  });
  if (blamed_jobs < options_.max_blamed_jobs) return;
  // A fault that all workers share, such as of the network, must not empty the farm.
  const KindCounts like = workers_.Count(Requirement::Of(state->traits.numeric_class, {}));
  if (like.set_aside + 1 >= like.available) return;
  const absl::Time until = now + options_.set_aside;
  workers_.Change(worker, [until](Worker& changed) { changed.set_aside_until = until; });
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
    workers_.Change(worker, [](Worker& state) {
      state.set_aside_until = absl::InfinitePast();
      state.blamed_jobs.clear();
    });
  }
}

}  // namespace lumifold::scheduler
