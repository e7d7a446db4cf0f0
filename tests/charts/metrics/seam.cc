#include "tests/charts/metrics/seam.h"

#include <cmath>
#include <limits>

#include "filter/image/check.h"
#include "filter/image/color.h"
#include "filter/image/planes.h"

namespace lumifold::metrics {
namespace {

/// Whether a pixel lies next to a tile boundary inside the picture.
bool IsBesideBoundary(int at, int size, int tile) {
  const bool is_first = at % tile == 0 && at > 0;
  const bool is_last = at % tile == tile - 1 && at + 1 < size;
  return is_first || is_last;
}

struct Sum {
  double total = 0;
  int64_t count = 0;

  double Mean() const { return count > 0 ? total / static_cast<double>(count) : 0.0; }
};

}  // namespace

double SeamIndex(const ConstColorView& tiled, const ConstColorView& untiled, int tile, float exposure) {
  const int width = untiled[0].width();
  const int height = untiled[0].height();
  LUMIFOLD_CHECK(tile > 2 && tiled[0].width() == width && tiled[0].height() == height);
  Sum boundary;
  Sum interior;
  ForEachPixel(width, height, [&](int x, int y) {
    double difference = 0;
    for (size_t c = 0; c < 3; ++c) {
      difference += static_cast<double>(std::abs(SrgbFromLinear(exposure * tiled[c].At(x, y)) -
                                                 SrgbFromLinear(exposure * untiled[c].At(x, y))));
    }
    Sum& sum = IsBesideBoundary(x, width, tile) || IsBesideBoundary(y, height, tile) ? boundary : interior;
    sum.total += difference;
    ++sum.count;
  });
  if (boundary.total == 0) return 0;
  return interior.total > 0 ? boundary.Mean() / interior.Mean() : std::numeric_limits<double>::infinity();
}

}  // namespace lumifold::metrics
