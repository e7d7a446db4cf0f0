#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

struct Lease {
  UnitIndex unit;
  job::WorkerId worker;
  absl::Time granted;
  absl::Time deadline;
  bool received = false;  // the worker has said so
  int64_t progress = 0;   // as the worker reported it last
  absl::Time progressed;  // when it last changed
  /// When to check whether the unit is late, and then whether it is overdue; InfiniteFuture if that is not
  /// known, or is_overdue.
  absl::Time check = absl::InfiniteFuture();
  bool is_late = false;
  absl::Time expected_end{};  // of a late lease, when it became late
  bool is_overdue = false;
  bool alone = false;  // of a unit in quarantine
  bool audit = false;  // the unit is accepted
};

/// The leases that are valid, by attempt, unit, worker and time. Every call takes O(log n) for each lease
/// it returns or changes. Lists are in ascending order of attempts, except where they say otherwise.
///
/// Threads: one at a time.
class LeaseTable {
 public:
  /// `attempt` is new.
  void Add(job::Attempt attempt, const Lease& lease);
  /// Null if no lease has this attempt; valid until the next Remove.
  const Lease* Find(job::Attempt attempt) const;
  /// Replaces the lease's state; the unit and worker stay.
  void Update(job::Attempt attempt, const Lease& lease);
  /// The lease exists; returns it.
  Lease Remove(job::Attempt attempt);

  std::vector<job::Attempt> OfUnit(const UnitIndex& unit) const;
  /// In the order of units.
  std::vector<job::Attempt> OfJob(int64_t job) const;
  std::vector<job::Attempt> OfWorker(job::WorkerId worker) const;
  /// Leases whose deadline is not after `now`, in the order of deadlines.
  std::vector<job::Attempt> Expired(absl::Time now) const;
  /// Leases whose check is not after `now`, in the order of checks.
  std::vector<job::Attempt> Checks(absl::Time now) const;
  /// The first deadline or check; InfiniteFuture without leases.
  absl::Time NextTime() const;
  int64_t size() const { return static_cast<int64_t>(by_attempt_.size()); }

 private:
  using Times = std::set<std::pair<absl::Time, job::Attempt>>;

  static void Move(job::Attempt attempt, absl::Time from, absl::Time to, Times* times);
  static std::vector<job::Attempt> NotAfter(absl::Time now, const Times& times);

  std::map<job::Attempt, Lease> by_attempt_;
  std::set<std::pair<UnitIndex, job::Attempt>> by_unit_;
  std::set<std::pair<job::WorkerId, job::Attempt>> by_worker_;
  Times by_deadline_;
  Times by_check_;  // without InfiniteFuture
};

}  // namespace lumifold::scheduler
