#pragma once

#include <cstdint>

namespace lumifold {

/// Sample indices [first, last) of every pixel of a rectangle.
struct SampleRange {
  uint32_t first = 0;
  uint32_t last = 0;

  uint32_t count() const { return last - first; }
  friend bool operator==(const SampleRange&, const SampleRange&) = default;
};

}  // namespace lumifold
