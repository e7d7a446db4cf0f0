#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "server/job/ids.h"
#include "server/scheduler/unit_index.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

/// Units with which workers were lost again and again: each is rendered once more, by a worker that renders
/// nothing else meanwhile. A worker is reserved for such a unit, gets no other leases until those that it has
/// are done, and then gets the unit. Pure state. Time: O(log n) a call, unless it says otherwise.
///
/// Threads: one at a time.
class Quarantine {
 public:
  /// A unit with which `max_lost_workers` workers were lost, or twice as many times any, is suspect. Reserves
  /// workers of `workers`, which must outlive it.
  Quarantine(int max_lost_workers, WorkerPool* workers)
      : max_lost_workers_(max_lost_workers), workers_(workers) {}

  /// Parties that lost workers with a unit, once for each loss.
  using Losses = std::multiset<std::string>;

  /// A worker of this party was lost with the unit.
  void AddLoss(const UnitIndex& unit, const std::string& party);
  const Losses& LossesOf(const UnitIndex& unit) const;
  /// The first unit of the job with which workers were lost.
  std::optional<UnitIndex> FirstLossOf(int64_t job) const;
  /// O(losses of the unit).
  bool IsSuspect(const UnitIndex& unit) const;
  /// The process with this WorkerTraits::instance, which was counted as lost with the unit, may come back.
  void NoteAbsence(uint64_t instance, const UnitIndex& unit);
  /// The process is here again: what it was lost with did not end it, and is no suspect because of it.
  /// Returns these units.
  std::vector<UnitIndex> TakeBackLosses(uint64_t instance, const std::string& party);
  /// Whether the unit, which was waiting, leaves the quarantine because it is no suspect any more.
  bool Release(const UnitIndex& unit);

  /// The unit, which is suspect and free, waits for a worker of its own.
  void Enter(const UnitIndex& unit) { waiting_.insert(unit); }
  /// Units that wait and have no worker yet.
  const std::set<UnitIndex>& waiting() const { return waiting_; }
  /// Reserves workers for waiting units. `requirement_of` says what a unit requires, null for one that is not
  /// to be leased now. O(units and workers that it looks at), which are bounded.
  /// `may_render` excludes workers that `requirement_of` admits.
  void Reserve(absl::FunctionRef<const Requirement*(const UnitIndex&)> requirement_of,
               absl::FunctionRef<bool(const Worker&, const UnitIndex&)> may_render);
  /// Reserved workers that have no other leases any more, each with its unit, which is to be leased now.
  std::vector<std::pair<job::WorkerId, UnitIndex>> TakeReady();
  /// Ends a reservation whose unit is not leased: the unit waits again.
  void Cancel(job::WorkerId worker);
  void CancelOfJob(int64_t job);
  /// A slot of the worker is free: a reservation whose unit is rendered ends.
  void EndIfIdle(job::WorkerId worker);
  /// The worker is gone.
  void Remove(job::WorkerId worker) { reservations_.erase(worker); }

  /// The unit is accepted: its losses count no more.
  void Forget(const UnitIndex& unit);
  void EndJob(int64_t job);

 private:
  struct Reservation {
    UnitIndex unit;
    bool leased = false;  // otherwise the worker still has other leases
  };

  std::optional<job::WorkerId> FindWorkerFor(
      const UnitIndex& unit, const Requirement& requirement,
      absl::FunctionRef<bool(const Worker&, const UnitIndex&)> may_render) const;
  void SetReserved(job::WorkerId worker, bool reserved);

  const int max_lost_workers_;
  WorkerPool* const workers_;
  std::map<UnitIndex, Losses> losses_;
  std::set<UnitIndex> waiting_;
  std::map<job::WorkerId, Reservation> reservations_;
  /// Units that processes were lost with which have not come back, by WorkerTraits::instance.
  std::map<uint64_t, std::vector<UnitIndex>> lost_with_;
};

}  // namespace lumifold::scheduler
