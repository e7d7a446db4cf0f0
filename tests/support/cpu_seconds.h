#pragma once

#include <ctime>

#include "filter/image/check.h"

namespace lumifold {

/// Processor time of this process so far, all threads together, in seconds: neighbours on the machine disturb
/// it least.
inline double CpuSeconds() {
  timespec now = {};
  LUMIFOLD_CHECK(clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) == 0);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace lumifold
