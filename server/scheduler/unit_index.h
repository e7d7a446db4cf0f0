#pragma once

#include <compare>
#include <cstdint>

namespace lumifold::scheduler {

/// Identifies a unit within its job: index of the frame, from 0, and number of the unit in the frame.
struct Place {
  int frame = 0;
  int64_t number = 0;
  friend auto operator<=>(const Place&, const Place&) = default;  // NOLINT(modernize-use-nullptr)
};

/// Identifies a unit among the active jobs; `job` is the scheduler's number of the job.
struct UnitIndex {
  int64_t job = 0;
  Place place;
  friend auto operator<=>(const UnitIndex&, const UnitIndex&) = default;  // NOLINT(modernize-use-nullptr)
};

}  // namespace lumifold::scheduler
