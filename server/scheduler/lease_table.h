#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"

namespace lumifold::scheduler {

/// Identifies a unit within its job: index of the frame, from 0, and number of the unit in the frame.
struct Place {
  int frame = 0;
  int64_t number = 0;
  friend auto operator<=>(const Place&, const Place&) = default;
};

/// Identifies a unit among the active jobs; `job` is the scheduler's number of the job.
struct UnitIndex {
  int64_t job = 0;
  Place place;
  friend auto operator<=>(const UnitIndex&, const UnitIndex&) = default;
};

struct Lease {
  UnitIndex unit;
  job::WorkerId worker;
  absl::Time deadline;
};

/// The leases that are valid, by attempt, unit, worker and deadline. Every call takes O(log n) for each lease
/// it returns or changes. Lists are in ascending order of attempts, except where they say otherwise.
/// Threads: one at a time.
class LeaseTable {
 public:
  /// `attempt` is new.
  void Add(job::Attempt attempt, const Lease& lease);
  /// Null if no lease has this attempt; valid until the next Remove.
  const Lease* Find(job::Attempt attempt) const;
  /// The lease exists.
  void SetDeadline(job::Attempt attempt, absl::Time deadline);
  /// The lease exists; returns it.
  Lease Remove(job::Attempt attempt);

  /// In the order of units.
  std::vector<job::Attempt> OfJob(int64_t job) const;
  std::vector<job::Attempt> OfWorker(job::WorkerId worker) const;
  /// Leases whose deadline is not after `now`, in the order of deadlines.
  std::vector<job::Attempt> Expired(absl::Time now) const;
  /// InfiniteFuture without leases.
  absl::Time NextDeadline() const;

 private:
  std::map<job::Attempt, Lease> by_attempt_;
  std::set<std::pair<UnitIndex, job::Attempt>> by_unit_;
  std::set<std::pair<job::WorkerId, job::Attempt>> by_worker_;
  std::set<std::pair<absl::Time, job::Attempt>> by_deadline_;
};

}  // namespace lumifold::scheduler
