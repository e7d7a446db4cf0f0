#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/lease_table.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// The beginning and the end of leases, and what becomes of their units. A unit has up to two leases, of
/// different workers. A lease that ends in vain is *released* where its worker knows of it, and *revoked*
/// where the worker is to be told.
/// Threads: one at a time.
class Leasing {
 public:
  /// A second lease is for a worker that hangs or is slow; a third would only cost.
  static constexpr size_t kMaxLeasesOfUnit = 2;

  enum class Kind {
    kOrdinary,
    kAlone,  // of a unit in quarantine
    kAudit,
  };

  /// `state` must outlive it.
  explicit Leasing(State* state);

  /// Leases a unit, which is taken from the free ones, to a worker with a free slot.
  GrantedLease Grant(const UnitIndex& unit, job::WorkerId worker, absl::Time now, Kind kind);
  /// A number above those of all leases so far, for a lease that is not of a unit.
  job::Attempt NextAttempt() { return job::Attempt(next_attempt_++); }
  /// Ends a lease. Its unit is not returned, its slot not released.
  Lease Remove(job::Attempt attempt);
  /// Ends a lease and returns its unit if it may be leased again; then `reason` is counted, if there is one.
  void Release(job::Attempt attempt, std::optional<RetryReason> reason);
  /// The same for a lease whose worker is to be told.
  void Revoke(job::Attempt attempt, std::optional<RetryReason> reason);
  /// Revokes all leases of a job that ends. Its units are not returned.
  void RevokeOfJob(int64_t job);
  /// A lease of the worker has ended, or a unit of it is committed.
  void ReleaseSlot(job::WorkerId worker);

  /// Whether the unit, which is not accepted, may be leased: no lease of it is in time.
  bool MayReturn(const UnitIndex& unit) const;
  /// The unit is free again, or its frame can be kept no longer.
  void Return(const UnitIndex& unit);
  /// The unit is no longer leased for its audit; no effect if it is not audited.
  void ReturnAudit(const UnitIndex& unit);
  void CountRetry(RetryReason reason) { ++retries_[reason]; }
  const std::map<RetryReason, int64_t>& retries() const { return retries_; }

  /// Leases that were revoked since the last call.
  std::vector<RevokedLease> TakeRevoked();

 private:
  void AddRevoked(job::Attempt attempt);

  State* const state_;
  int64_t next_attempt_;
  std::vector<RevokedLease> revoked_;
  std::map<RetryReason, int64_t> retries_;
};

}  // namespace lumifold::scheduler
