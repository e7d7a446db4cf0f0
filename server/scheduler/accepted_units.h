#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "server/job/ids.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// Units that were delivered and are not committed yet. A worker does not wait for slow storage: its slot is
/// free again when its unit is accepted, as long as the bytes that wait to be committed are below a limit;
/// then it is free when the unit is committed. Pure state. Time: O(log n) a call, unless it says otherwise.
/// Threads: one at a time.
class AcceptedUnits {
 public:
  explicit AcceptedUnits(uint64_t max_bytes) : max_bytes_(max_bytes) {}

  /// `unit` is not accepted. True if the worker's slot is free at once.
  bool Add(const UnitIndex& unit, job::WorkerId worker, uint64_t bytes);
  bool Has(const UnitIndex& unit) const { return units_.contains(unit); }
  /// The unit is accepted. It is committed, or its job has ended. Returns the worker whose slot is free now.
  std::optional<job::WorkerId> Remove(const UnitIndex& unit);
  /// The job's units. O(those).
  std::vector<UnitIndex> OfJob(int64_t job) const;

 private:
  struct Accepted {
    std::optional<job::WorkerId> worker;  // whose slot it fills
    uint64_t bytes = 0;
  };

  const uint64_t max_bytes_;
  uint64_t bytes_ = 0;
  std::map<UnitIndex, Accepted> units_;
};

}  // namespace lumifold::scheduler
