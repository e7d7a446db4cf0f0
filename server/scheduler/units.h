#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "filter/image/tile_samples.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/ids.h"
#include "server/job/unit.h"
#include "server/scheduler/audits.h"
#include "server/scheduler/disputes.h"
#include "server/scheduler/frames.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Units, from the delivery for a lease to the commit.
///
/// A unit is free, leased, accepted (delivered, not yet committed) or committed. Only a leased unit is
/// accepted, only an accepted unit is committed; accepted and committed units never become free again
/// unless Revoke says so. This is the exactly-once promise. The other lease of a unit is revoked when it is
/// accepted.
///
/// Numeric class: all units of a job are of one class, that of its first accepted unit unless its options
/// name one. Until then workers of all classes may lease its units; then the leases of the other classes are
/// revoked.
///
/// Threads: one at a time.
class Units {
 public:
  /// All must outlive it.
  Units(State* state, Frames* frames, Leasing* leasing, Audits* audits, Disputes* disputes);

  bool HoldsLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  /// Sample indices of a unit that is leased or accepted.
  TileSamples SamplesOf(const job::UnitRef& unit) const;
  int64_t lease_count() const { return state_->leases.size(); }

  /// Records that a worker delivered a complete unit. `digest` is equal for equal pixels, and empty only
  /// where no job is audited.
  Completion Complete(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt, absl::Time now,
                      absl::string_view digest = "", const UnitCost& cost = {});
  /// Records that a worker could not render a unit, see Disputes. One that ran out of memory is no evidence:
  /// the job goes to workers that have more, for SchedulerOptions::cool_down. False if it does not hold the
  /// lease.
  bool Fail(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt, const UnitFailure& failure,
            absl::Time now);
  /// The worker will not deliver the unit: it is free at once. This is neither a failure nor a loss. False if
  /// the worker does not hold the lease.
  bool HandBack(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt);

  /// Records that an accepted unit is committed. True when its frame is committed now.
  bool Commit(const job::UnitRef& unit);
  /// Records that the accepted plan unit of a job is committed: the job now has this spec, and the units of
  /// its frames. No effect if the job has ended.
  void SetPlan(const job::UnitRef& unit, const v1::JobSpec& planned);
  /// Makes a committed unit free again, because its record was lost. False for a unit that is not committed,
  /// and for one of a finished frame.
  bool Revoke(const job::UnitRef& unit);
  /// Restores a unit that was committed before a restart. Call it before any lease of the job. False for a
  /// unit that the job does not have.
  bool Restore(const job::JobId& job, const RestoredUnit& unit, absl::Time now);

  /// Leases that were revoked since the last call: their workers do not know it. A caller that tells them,
  /// before it sends them new leases, ends work that is in vain.
  std::vector<RevokedLease> TakeRevoked() { return leasing_->TakeRevoked(); }

  // For the other parts of the scheduler.

  /// Frees the units whose pause after a failure is over, and lets smaller workers try again jobs with which
  /// one ran out of memory some time ago.
  void EndPauses(absl::Time now);

 private:
  /// The unit is accepted for `lease`: its worker is rated, and what it met before is forgotten.
  void OnAccepted(const Lease& lease, const UnitCost& cost, absl::Time now);
  void CountTime(const Lease& lease, absl::Time now);
  void RevokeOtherLeases(const UnitIndex& unit);
  void Bind(Job& job, const std::string& numeric_class);
  void RequireMemory(Job& job);
  void Require(Job& job, const Requirement& requirement);
  /// A worker ran out of memory with the unit, whose lease has been removed.
  void ReturnToLarger(const Lease& lease, const Worker& worker, absl::Time now);
  void ReturnAfter(const UnitIndex& unit, absl::Duration pause, absl::Time now);
  /// A frame is restored: where earlier ones were kept, and nothing of them is left, its units do not wait
  /// for theirs, which may not be leased while frames like this one are in flight.
  static void ReturnOutOfOrder(Job& job, int frame);
  /// The unit, which is accepted, is committed.
  void EndAccepted(const UnitIndex& unit);

  State* const state_;
  Frames* const frames_;
  Leasing* const leasing_;
  Audits* const audits_;
  Disputes* const disputes_;
};

}  // namespace lumifold::scheduler
