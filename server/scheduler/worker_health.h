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

/// Failures of units, and which workers get no leases because of them or because an operator says so. A
/// failed unit goes to another worker: if that fails too, the job is at fault; if it renders the unit, the
/// failure is attributed to the first worker, which cools down after failures in several jobs. Pure state.
/// Time: O(log n) a call, unless it says otherwise.
/// Threads: one at a time.
class WorkerHealth {
 public:
  /// What a unit that was leased in vain has met.
  struct Failures {
    int count = 0;
    std::string last_worker;  // name of the last one that failed or dropped it; it may reconnect
    std::set<job::WorkerId> workers;
    std::set<std::string> permanent_by;  // names of workers that called the failure permanent
  };

  /// Workers of `workers`, which must outlive it, cool down and are blocked.
  WorkerHealth(const SchedulerOptions& options, WorkerPool* workers);

  /// A connected worker could not render a unit.
  const Failures& CountFailure(const UnitIndex& unit, job::WorkerId worker, bool permanent);
  /// A connected worker no longer renders a unit and does not say why: no failure, but the unit goes to
  /// another one if there is one.
  void CountDrop(const UnitIndex& unit, job::WorkerId worker);
  /// Whether the worker with this name was the last to fail or drop the unit.
  bool WasLastToFail(const UnitIndex& unit, const std::string& name) const;
  /// Workers that failed or dropped free units of the job. O(such units).
  std::set<job::WorkerId> FailedWorkersOf(int64_t job) const;
  /// `worker` has rendered the unit: its failures are attributed to the others that failed it, and forgotten.
  void AttributeFailures(const UnitIndex& unit, job::WorkerId worker, absl::Time now);
  /// Forgets the failures of a job's units. What they say of workers stays.
  void EndJob(int64_t job);
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
  void Attribute(job::WorkerId worker, int64_t job, absl::Time now);
  /// What is said against a worker is forgotten.
  void EndCoolDown(job::WorkerId worker);

  const int max_attributed_jobs_;
  const absl::Duration cool_down_;
  WorkerPool* const workers_;
  std::map<UnitIndex, Failures> failures_;
  /// Jobs of which other workers rendered a unit that this one had failed, and when that was last.
  std::map<job::WorkerId, std::map<int64_t, absl::Time>> attributed_;
  std::map<std::string, std::string> blocked_;
  std::vector<CoolingWorker> cooling_;
  std::vector<FaultyWorker> faulty_;
};

}  // namespace lumifold::scheduler
