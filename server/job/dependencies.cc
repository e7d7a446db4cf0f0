#include "server/job/dependencies.h"

#include <algorithm>
#include <deque>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "server/job/job_state.h"

namespace lumifold::job {
namespace {

bool HasEndedBadly(v1::JobState state) {
  return state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED ||
         state == v1::JOB_STATE_UNSPECIFIED;
}

std::string ReasonOf(const Prerequisite& ended) {
  const char* const what = ended.state == v1::JOB_STATE_FAILED      ? "has failed"
                           : ended.state == v1::JOB_STATE_CANCELLED ? "was cancelled"
                                                                    : "was deleted";
  return absl::StrCat("job ", ended.job.value(), ", which it waits for, ", what);
}

}  // namespace

std::vector<JobId> Dependencies::NamedBy(const JobId& job) const {
  std::vector<JobId> jobs;
  for (auto it = named_by_.lower_bound({job, JobId()}); it != named_by_.end() && it->first == job; ++it)
    jobs.push_back(it->second);
  return jobs;
}

void Dependencies::Remove(const JobId& job) {
  const auto found = waiting_.find(job);
  if (found == waiting_.end()) return;
  for (const JobId& named : found->second.after) named_by_.erase({named, job});
  waiting_.erase(found);
}

Settled Dependencies::Add(const JobId& job, absl::Span<const Prerequisite> after) {
  LUMIFOLD_CHECK(!waiting_.contains(job));
  Waiting waiting{.number = next_number_++, .after = {}, .unmet = {}};
  for (const Prerequisite& prerequisite : after) {
    if (HasEndedBadly(prerequisite.state)) return {{}, {{job, ReasonOf(prerequisite)}}};
    waiting.after.insert(prerequisite.job);
    if (!IsDone(prerequisite.state)) waiting.unmet.insert(prerequisite.job);
  }
  if (waiting.unmet.empty()) return {{job}, {}};
  for (const JobId& named : waiting.after) named_by_.emplace(named, job);
  waiting_.emplace(job, std::move(waiting));
  return {};
}

Settled Dependencies::Ended(const JobId& job, v1::JobState state) {
  Settled settled;
  Remove(job);
  std::deque<Prerequisite> ended = {{job, state}};
  std::vector<std::pair<int64_t, JobId>> released;
  while (!ended.empty()) {
    const Prerequisite next = ended.front();
    ended.pop_front();
    for (const JobId& dependent : NamedBy(next.job)) {
      Waiting& waiting = waiting_.at(dependent);
      if (HasEndedBadly(next.state)) {
        settled.hopeless.push_back({dependent, ReasonOf(next)});
        ended.push_back({dependent, v1::JOB_STATE_FAILED});
        Remove(dependent);
        continue;
      }
      waiting.unmet.erase(next.job);
      if (!waiting.unmet.empty()) continue;
      released.emplace_back(waiting.number, dependent);
      Remove(dependent);
    }
  }
  std::sort(released.begin(), released.end());
  for (auto& [number, id] : released) settled.released.push_back(std::move(id));
  return settled;
}

void Dependencies::Reopened(const JobId& job) {
  for (const JobId& dependent : NamedBy(job)) waiting_.at(dependent).unmet.insert(job);
}

std::set<JobId> Dependencies::Named() const {
  std::set<JobId> jobs;
  for (const auto& [named, dependent] : named_by_) jobs.insert(named);
  return jobs;
}

std::vector<JobId> Dependencies::WaitsFor(const JobId& job) const {
  const auto found = waiting_.find(job);
  if (found == waiting_.end()) return {};
  return {found->second.unmet.begin(), found->second.unmet.end()};
}

}  // namespace lumifold::job
