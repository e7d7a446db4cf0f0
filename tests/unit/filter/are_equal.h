#pragma once

#include <algorithm>
#include <cstddef>

#include "absl/types/span.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Of one size.
inline bool AreEqual(absl::Span<const Plane> a, absl::Span<const Plane> b) {
  for (size_t c = 0; c < a.size(); ++c) {
    for (int y = 0; y < a[c].height(); ++y) {
      if (!std::equal(a[c].Row(y), a[c].Row(y) + a[c].width(), b[c].Row(y))) return false;
    }
  }
  return a.size() == b.size();
}

}  // namespace lumifold::filter
