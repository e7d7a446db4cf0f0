#pragma once

#include <algorithm>
#include <cmath>

#include "absl/types/span.h"
#include "filter/image/plane.h"

namespace lumifold::filter {

inline bool IsFinite(absl::Span<const Plane> planes) {
  const auto is_finite = [](float value) { return std::isfinite(value); };
  for (const Plane& plane : planes) {
    for (int y = 0; y < plane.height(); ++y) {
      if (!std::all_of(plane.Row(y), plane.Row(y) + plane.width(), is_finite)) return false;
    }
  }
  return true;
}

}  // namespace lumifold::filter
