#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// The mean of a plane's values. Each row is summed separately, so that small values are not lost in a large
/// sum.
inline double MeanOf(ConstFloatView plane) {
  double total = 0;
  for (int y = 0; y < plane.height(); ++y) {
    double row = 0;
    for (int x = 0; x < plane.width(); ++x) row += static_cast<double>(plane.At(x, y));
    total += row;
  }
  return total / (static_cast<double>(plane.width()) * plane.height());
}

}  // namespace lumifold::metrics
