#include "server/scheduler/ready_jobs.h"

#include <algorithm>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::scheduler {
namespace {

/// One of this many leases may go to the job that has waited longest, see SchedulerOptions::longest_wait:
/// with more waiting jobs than the farm can serve, the others must not get the order of a queue.
constexpr int64_t kGrantsPerWaiting = 8;

}  // namespace

ReadyJobs::ReadyJobs(const SchedulerOptions& options, const WorkerPool* workers)
    : locality_(options.locality), longest_wait_(options.longest_wait), workers_(workers) {}

void ReadyJobs::Add(int64_t job, const JobOptions& options) {
  share_.AddJob(job, options.user, options.priority, options.turn);
  const Requirement requirement = Requirement::Of(options.numeric_class, options.tags);
  LUMIFOLD_CHECK(entries_.emplace(job, Entry{Enter(requirement)}).second);
}

void ReadyJobs::Remove(int64_t job) {
  Leave(job, absl::InfinitePast());
  share_.RemoveJob(job);
  entries_.erase(job);
}

ReadyJobs::Demands::iterator ReadyJobs::Enter(const Requirement& requirement) {
  const auto demand = demands_.try_emplace(requirement).first;
  ++demand->second.jobs;
  return demand;
}

void ReadyJobs::Leave(int64_t job, absl::Time now) {
  Set(job, Readiness::kNone, now);  // other jobs may keep the demand
  const auto demand = entries_.at(job).demand;
  if (--demand->second.jobs == 0) demands_.erase(demand);
}

void ReadyJobs::SetRequirement(int64_t job, const Requirement& requirement, absl::Time now) {
  Leave(job, now);
  entries_.at(job).demand = Enter(requirement);
}

void ReadyJobs::Set(int64_t job, Readiness readiness, absl::Time now) {
  Entry& entry = entries_.at(job);
  if (entry.readiness == readiness) return;
  entry.readiness = readiness;
  Demand& demand = entry.demand->second;
  FairShare::Queue* queue = nullptr;
  if (readiness == Readiness::kUnit) queue = &demand.with_unit;
  if (readiness == Readiness::kOpensFrame) queue = &demand.opening_frame;
  share_.SetQueue(job, queue, now);
}

void ReadyJobs::CountFrames(int64_t job, int change) {
  if (change == 0) return;
  const auto demand = entries_.at(job).demand;
  demand->second.active_frames += change;
  if (workers_->Count(demand->first).available > 0) live_frames_ += change;
}

void ReadyJobs::SetMaxActiveFrames(int frames) {
  LUMIFOLD_CHECK(frames >= 1);
  max_active_frames_ = frames;
}

int ReadyJobs::active_frames() const {
  int frames = 0;
  for (const auto& [requirement, demand] : demands_) {
    if (workers_->Count(requirement).available > 0) frames += demand.active_frames;
  }
  return frames;
}

void ReadyJobs::FollowWorkers() {
  if (counted_kinds_ == workers_->version()) return;
  counted_kinds_ = workers_->version();
  live_frames_ = active_frames();
}

bool ReadyJobs::HasAny(const Requirement& kind) const {
  const bool may_open = MayOpenFrame();
  return std::any_of(demands_.begin(), demands_.end(), [&](const auto& entry) {
    const Demand& demand = entry.second;
    return (!demand.with_unit.IsEmpty() || (may_open && !demand.opening_frame.IsEmpty())) &&
           entry.first.Admits(kind);
  });
}

std::optional<int64_t> ReadyJobs::Next(const Worker& worker, const std::set<int64_t>& passed,
                                       absl::Time now) {
  const Requirement& kind = workers_->KindOf(worker.kind);
  const int64_t last = worker.last_job;
  const bool last_is_known = entries_.contains(last);
  std::optional<FairShare::Candidate> first;
  std::pair<absl::Time, int64_t> longest_waiting(absl::InfiniteFuture(), 0);
  bool may_stay = false;
  const auto look = [&](FairShare::Queue& queue) {
    if (queue.IsEmpty()) return;
    const std::optional<FairShare::Candidate> candidate = share_.First(queue, passed);
    if (candidate.has_value() && (!first.has_value() || *candidate < *first)) first = candidate;
    longest_waiting = std::min(longest_waiting, *share_.LongestWaiting(queue));
    may_stay = may_stay || (last_is_known && share_.QueueOf(last) == &queue);
  };
  for (auto& [requirement, demand] : demands_) {
    if (!requirement.Admits(kind)) continue;
    look(demand.with_unit);
    if (MayOpenFrame()) look(demand.opening_frame);
  }
  if (!first.has_value()) return std::nullopt;
  if (grants_ % kGrantsPerWaiting == 0 && longest_waiting.first + longest_wait_ <= now &&
      !passed.contains(longest_waiting.second))
    return longest_waiting.second;
  if (may_stay && last != first->job && !passed.contains(last) && share_.IsNear(last, *first, locality_))
    return last;
  share_.Choose(*first);
  return first->job;
}

void ReadyJobs::Granted(int64_t job, absl::Time now) {
  ++grants_;
  share_.Granted(job, now);
}

}  // namespace lumifold::scheduler
