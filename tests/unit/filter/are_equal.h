#pragma once

#include <algorithm>
#include <cstddef>

#include "filter/image/planes.h"

namespace lumifold::filter {

inline bool AreEqual(const Picture& a, const Picture& b) {
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < a[c].height(); ++y) {
      if (!std::equal(a[c].Row(y), a[c].Row(y) + a[c].width(), b[c].Row(y))) return false;
    }
  }
  return true;
}

}  // namespace lumifold::filter
