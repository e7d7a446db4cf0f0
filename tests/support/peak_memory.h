#pragma once

#include <sys/resource.h>

#include <cstdint>

namespace lumifold {

/// The most memory this process has had at a time, in bytes.
inline int64_t PeakMemoryBytes() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return int64_t{usage.ru_maxrss} * 1024;
}

/// What a refused picture or mesh may take on top of what a test has taken before.
inline constexpr int64_t kRefusalBytes = int64_t{32} << 20;

}  // namespace lumifold
