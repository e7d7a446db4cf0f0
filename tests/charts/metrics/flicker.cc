#include "tests/charts/metrics/flicker.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/color.h"

namespace lumifold::metrics {

Flicker MeasureFlicker(const ConstColorView& picture, const ConstColorView& next, float exposure) {
  const int width = picture[0].width();
  const int height = picture[0].height();
  LUMIFOLD_CHECK(width > 0 && height > 0 && next[0].width() == width && next[0].height() == height);
  std::vector<float> steps;
  double total = 0;
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      double row = 0;
      for (int x = 0; x < width; ++x) {
        const float step = 255.0f * std::abs(SrgbFromLinear(exposure * picture[c].At(x, y)) -
                                             SrgbFromLinear(exposure * next[c].At(x, y)));
        steps.push_back(step);
        row += static_cast<double>(step);
      }
      total += row;
    }
  }
  const auto at = steps.begin() + static_cast<std::ptrdiff_t>((steps.size() - 1) * 99 / 100);
  std::nth_element(steps.begin(), at, steps.end());
  return {total / static_cast<double>(steps.size()), static_cast<double>(*at)};
}

}  // namespace lumifold::metrics
