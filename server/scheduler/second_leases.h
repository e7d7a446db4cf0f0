#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/job_units.h"
#include "server/scheduler/lease_table.h"
#include "server/scheduler/types.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

/// How long the units of each job take, which leases take longer, and which of these get a second lease where
/// slots would be idle otherwise. A lease is first late, then overdue. Pure state. Time: O(log n) a call,
/// unless it says otherwise.
///
/// Threads: one at a time.
class SecondLeases {
 public:
  /// Units whose times are compared: those of one job and size, see JobUnits::SizeOf.
  struct Kind {
    int64_t job = 0;
    size_t size = 0;
  };
  /// What becomes of a late lease that Take looks at.
  enum class Use {
    kTake,  // its unit gets a second lease
    kDrop,  // it has one
    kKeep,
  };

  explicit SecondLeases(const SchedulerOptions& options);

  /// Counts the time from lease to delivery of an accepted unit. True when the mean of its kind becomes known
  /// with it: Schedule follows for the leases of the job.
  bool CountTime(const Kind& kind, absl::Duration time);
  /// Mean of the accepted units of a kind; nullopt if they are too few to tell.
  std::optional<absl::Duration> MeanOf(const Kind& kind) const;
  /// Relates the worker's time for a unit to the mean of its kind.
  static void Rate(absl::Duration time, absl::Duration mean, Worker* worker);

  /// When a lease granted at `granted` is overdue; InfiniteFuture if the mean is not known.
  absl::Time OverdueTime(const Kind& kind, absl::Time granted) const;
  /// When the lease is late; not after it is overdue. Where the mean is not known, as for a plan unit, it is
  /// late when it has made no progress for the length of a lease. `slowness`: of its worker.
  absl::Time LateTime(const Kind& kind, double slowness, const Lease& lease) const;
  /// Sets when a lease is checked next.
  void Schedule(const Kind& kind, double slowness, Lease* lease) const;
  /// Checks a lease whose check is not after `now`. True if it is late from now on.
  bool MarkLate(const Kind& kind, double slowness, absl::Time now, Lease* lease) const;
  /// The same after MarkLate. True if the lease is overdue from now on.
  bool MarkOverdue(const Kind& kind, absl::Time now, Lease* lease) const;
  /// The same for an audit and for a unit in quarantine, which idle slots do not get when they are late: they
  /// are overdue where others are, or late where the mean is not known.
  bool MarkOnlyOverdue(const Kind& kind, absl::Time now, Lease* lease) const;
  /// Whether a worker of this slowness, which has a free slot, would probably end the unit of a late lease
  /// earlier.
  bool IsWorthwhile(const Lease& late, const Kind& kind, double slowness, absl::Time now) const;

  /// Enters a late lease, the only one of its unit, of a job with this requirement.
  void Enter(const Requirement& requirement, absl::Time expected_end, job::Attempt attempt);
  /// No effect on a lease that is not entered.
  void Remove(const Requirement& requirement, absl::Time expected_end, job::Attempt attempt);
  /// Whether a late lease is of a job that workers of this kind may render. O(requirements).
  bool HasAny(const Requirement& worker_kind) const;
  /// Takes the first lease that `use` wants to take, and removes those that it drops before: by requirement,
  /// those with the latest expected end first. Looks at a few only.
  std::optional<job::Attempt> Take(const Requirement& worker_kind, absl::FunctionRef<Use(job::Attempt)> use);

  /// Forgets the times of a job, which has ended or is divided into other units.
  void ForgetTimes(int64_t job) { times_.erase(job); }

 private:
  struct UnitTimes {
    int64_t count = 0;
    absl::Duration sum;
  };

  absl::Time OnlyCheckOf(const Kind& kind, const Lease& lease) const;

  const absl::Duration standstill_;
  const double late_factor_;
  const double overdue_factor_;
  const absl::Duration overdue_least_;
  std::map<int64_t, std::array<UnitTimes, JobUnits::kSizes>> times_;  // by job
  /// Late leases by their expected ends; never empty.
  std::map<Requirement, std::set<std::pair<absl::Time, job::Attempt>>> late_;
};

}  // namespace lumifold::scheduler
