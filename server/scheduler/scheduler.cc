#include "server/scheduler/scheduler.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "server/scheduler/explain.h"

namespace lumifold::scheduler {

Scheduler::Scheduler(const SchedulerOptions& options)
    : state_(options),
      leasing_(&state_),
      frames_(&state_),
      disputes_(&state_),
      watch_(&state_, &leasing_, &disputes_),
      workers_(&state_, &leasing_, &watch_),
      audits_(&state_, &frames_, &leasing_, &workers_),
      units_(&state_, &frames_, &leasing_, &audits_, &disputes_),
      jobs_(&state_, &frames_, &leasing_),
      keeping_(&state_, &frames_, &leasing_),
      grants_(&state_, &frames_, &leasing_, &keeping_) {}

std::vector<LateLease> Scheduler::ExpireLeases(absl::Time now) {
  state_.SetTime(now);
  units_.EndPauses(now);
  audits_.Expire(now);
  state_.health.EndCoolDowns(now);
  std::vector<LateLease> late = watch_.Expire(now);
  disputes_.Expire(now);
  return late;
}

std::vector<FailedJob> Scheduler::TakeFailedJobs() { return std::exchange(state_.failed, {}); }

absl::Time Scheduler::NextExpiry() const {
  return std::min({state_.leases.NextTime(), state_.workers.NextCooled(), state_.audits.NextDue(),
                   state_.backoffs.NextEnd(), state_.evidence.NextDue(), state_.ready.memory().NextEnd()});
}

std::vector<Reason> Scheduler::Explain(const job::JobId& job, absl::Time now) const {
  return scheduler::Explain(state_, job, now);
}

Metrics Scheduler::CountAll() const {
  Metrics metrics;
  metrics.leases_expired = watch_.expired();
  metrics.retries = leasing_.retries();
  for (const auto& [number, job] : state_.jobs.all()) {
    metrics.units_leased += job.leases.units;
    if (!job.paused)
      metrics.units_queued += job.units.total() - job.frames.committed_units() - job.leases.units -
                              static_cast<int64_t>(state_.accepted.OfJob(number).size());
  }
  for (const job::WorkerId id : state_.workers.After(job::WorkerId(0), std::numeric_limits<int>::max())) {
    const Worker& worker = *state_.workers.Find(id);
    metrics.slots += worker.traits.slots;
    ++metrics.workers[StateOf(worker)];
  }
  return metrics;
}

}  // namespace lumifold::scheduler
