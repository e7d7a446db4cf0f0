#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "absl/types/span.h"
#include "server/job/ids.h"
#include "server/scheduler/disputes.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Watches leases: whether their workers renew them and make progress, and which are late. A lease that ends
/// with its worker counts as a loss of the worker with the unit, see Quarantine.
///
/// Threads: one at a time.
class LeaseWatch {
 public:
  /// All must outlive it.
  LeaseWatch(State* state, Leasing* leasing, Disputes* disputes)
      : state_(state), leasing_(leasing), disputes_(disputes) {}

  /// Renews the worker's leases that are in `held` and have progressed within SchedulerOptions::stall, and
  /// ends those that are not in `held`, except leases with an attempt above `newest`, the last attempt that
  /// the worker had received when it sent the heartbeat. Returns the ended ones: each counts as a loss of
  /// the worker with the unit, which another worker gets next if there is one.
  std::vector<LateLease> Heartbeat(job::WorkerId worker, absl::Span<const HeldLease> held,
                                   job::Attempt newest, absl::Time now);
  /// Revokes leases whose deadline is not after `now`, and makes overdue units ready for a second lease. A
  /// silent worker gets no new leases until its next heartbeat; a stalled lease keeps its slot until a
  /// heartbeat no longer names it.
  std::vector<LateLease> Expire(absl::Time now);
  /// Leases that expired, since the start.
  int64_t expired() const { return expired_; }

  /// Counts the loss of a worker with a unit, unless the worker has not said that it received the lease. If
  /// it rendered nothing else, those that were lost with the unit call it impossible, see Disputes.
  void CountLoss(const Lease& lease);
  /// The worker of the lease, which counted as lost with its unit, may come back.
  void NoteAbsence(const Lease& lease);
  /// The worker's process is here again.
  void TakeBackLosses(job::WorkerId worker);
  /// The worker is gone.
  void Remove(job::WorkerId worker);

 private:
  void Renew(job::Attempt attempt, int64_t progress, absl::Time now);
  LateLease Drop(job::Attempt attempt);
  LateLease End(job::Attempt attempt);
  /// Whether the lease is overdue from now on, and its unit ready for a second one. An audit is then another
  /// worker's.
  bool BecomesOverdue(job::Attempt attempt, absl::Time now);
  bool ReturnOverdue(const UnitIndex& unit);
  void EndLateAudit(job::Attempt attempt);

  State* const state_;
  Leasing* const leasing_;
  Disputes* const disputes_;
  std::set<std::pair<job::WorkerId, job::Attempt>> stalled_;  // revoked, but still in a slot of the worker
  int64_t expired_ = 0;
};

}  // namespace lumifold::scheduler
