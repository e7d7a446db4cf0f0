#pragma once

#include "server/scheduler/unit_index.h"
#include "server/scheduler/worker_pool.h"

/// Units, workers and times of the tests of the scheduler's parts.
namespace lumifold::scheduler {

inline const job::WorkerId kAnn(1);
inline const job::WorkerId kBen(2);
inline const absl::Time kNow = absl::FromUnixSeconds(1000);
inline constexpr UnitIndex kFirst{7, {0, 1}};
inline constexpr UnitIndex kSecond{7, {0, 2}};
inline constexpr UnitIndex kOfOther{8, {0, 0}};
inline const Requirement kAvx2{"avx2", {}};

}  // namespace lumifold::scheduler
