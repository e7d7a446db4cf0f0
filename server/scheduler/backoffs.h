#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "proto/retry/pauses.h"
#include "server/scheduler/types.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// Units that pause after a failure before they are leased again. Pure state. Time: O(log n) for each unit.
///
/// Threads: one at a time.
class Backoffs {
 public:
  struct Pause {
    Place place;
    absl::Time end;
  };

  explicit Backoffs(const SchedulerOptions& options) : lengths_(options.backoff) {}

  /// The pause after the last of `failures` failures of a unit.
  absl::Duration LengthAfter(int failures) const { return lengths_.After(failures); }
  /// The unit pauses until `end`, and no longer until an earlier one.
  void Begin(const UnitIndex& unit, absl::Time end);
  /// The unit, if it pauses, does so no more.
  void End(const UnitIndex& unit);
  /// Ends the pauses whose end is not after `now`; the units in the order of these ends.
  std::vector<UnitIndex> TakeEnded(absl::Time now);
  /// When the next pause ends; InfiniteFuture without pauses.
  absl::Time NextEnd() const;

  int64_t CountOf(int64_t job) const;
  /// The pause of the job that ends last; nullopt if it has none. O(pauses).
  std::optional<Pause> LongestOf(int64_t job) const;
  /// Forgets the pauses of a job, which has ended or is divided into other units.
  void ForgetJob(int64_t job);

 private:
  const retry::Pauses lengths_;
  std::set<std::pair<absl::Time, UnitIndex>> by_end_;
  std::map<UnitIndex, absl::Time> by_unit_;
};

}  // namespace lumifold::scheduler
