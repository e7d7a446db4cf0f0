#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/types.h"
#include "server/scheduler/unit_index.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

/// Which workers get no leases, because they fail units that others render, or because an operator says so.
/// Pure state.
/// Time: O(log n) a call, unless it says otherwise.
/// Threads: one at a time.
class WorkerHealth {
 public:
  /// Workers of `workers`, which must outlive it, cool down and are blocked.
  WorkerHealth(const SchedulerOptions& options, WorkerPool* workers);

  /// The worker failed or dropped a unit of the job, and another one has rendered it.
  void Attribute(job::WorkerId worker, int64_t job, absl::Time now);
  /// The worker is gone.
  void Remove(job::WorkerId worker) { attributed_.erase(worker); }

  /// Ends the cool-downs that are over at `now`.
  void EndCoolDowns(absl::Time now);
  /// Why the worker cools down; empty if it does not.
  std::string CoolDownReason(job::WorkerId worker) const;
  /// Workers that began to cool down since the last call.
  std::vector<CoolingWorker> TakeCooling();

  /// The workers of this name get no leases until Readmit, those that connect later included.
  void Block(const std::string& name, const std::string& reason);
  bool IsBlocked(const std::string& name) const { return blocked_.contains(name); }
  /// Reasons, by the worker's name.
  const std::map<std::string, std::string>& blocked() const { return blocked_; }
  /// Ends a block, drain or cool-down. False if no worker has this name.
  bool Readmit(const std::string& name);

  /// A worker was found faulty, for TakeFaulty.
  void AddFaulty(FaultyWorker faulty);
  std::vector<FaultyWorker> TakeFaulty();

 private:
  /// What is said against a worker is forgotten.
  void EndCoolDown(job::WorkerId worker);

  const int max_attributed_jobs_;
  const absl::Duration cool_down_;
  WorkerPool* const workers_;
  /// Jobs of which other workers rendered a unit that this one had failed, and when that was last.
  std::map<job::WorkerId, std::map<int64_t, absl::Time>> attributed_;
  std::map<std::string, std::string> blocked_;
  std::vector<CoolingWorker> cooling_;
  std::vector<FaultyWorker> faulty_;
};

}  // namespace lumifold::scheduler
