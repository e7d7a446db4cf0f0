#pragma once

#include <optional>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/frames.h"
#include "server/scheduler/keeping.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Which unit a free worker gets. Whose turn it is, is up to ReadyJobs. Frames in the order of the job's
/// frame list; within a frame as FrameUnits numbers its units. A unit whose lease has ended in vain is
/// granted before units that were never leased, but not to the worker that failed it last while another
/// worker that may render the job is available. Where several workers are free, the one that was added
/// first gets the unit. Where slots are idle, late units are leased to a second worker. Threads: one at a
/// time.
class Grants {
 public:
  /// All must outlive it.
  Grants(State* state, Frames* frames, Leasing* leasing, Keeping* keeping);

  /// Grants leases until all slots are full or no unit is free; the leases of a worker are consecutive.
  std::vector<GrantedLease> ToAll(absl::Time now);
  /// Grants leases to one worker; none of units in quarantine.
  std::vector<GrantedLease> ToWorker(job::WorkerId worker, absl::Time now);

 private:
  struct Taken {
    Place place;
    bool audit = false;
  };
  // What one call may still look at in vain, see kMaxSkipped.
  using SkipBudget = int;

  void Begin(absl::Time now);
  void GrantTo(job::WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<Taken> TakeUnit(Job& job, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeReturnedUnit(Job& job, job::WorkerId worker, SkipBudget* budget);
  std::optional<Place> TakeUnleasedUnit(Job& job, job::WorkerId worker);
  /// Whether the worker gets no units of the job, see Disputes.
  bool IsExcluded(int64_t job, const Worker& worker) const;
  bool MayLease(const UnitIndex& unit, job::WorkerId worker) const;
  /// Reserves workers for units in quarantine, and leases the units to those that have become idle.
  void GrantQuarantined(absl::Time now, std::vector<GrantedLease>* granted);
  /// Leases late units to workers that have idle slots.
  void GrantSecond(absl::Time now, std::vector<GrantedLease>* granted);
  std::optional<UnitIndex> TakeLateUnit(job::WorkerId worker, const Requirement& kind, absl::Time now);
  bool IsWorthASecondLease(const Lease& lease, job::WorkerId worker, absl::Time now) const;

  State* const state_;
  Frames* const frames_;
  Leasing* const leasing_;
  Keeping* const keeping_;
};

}  // namespace lumifold::scheduler
