#include "filter/metrics/heat_map.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/color.h"
#include "filter/image/planes.h"

namespace lumifold::metrics {
namespace {

using Color = std::array<float, 3>;

/// sRGB colours at equal steps from 0 to the top.
constexpr std::array<Color, 6> kColors = {{{0.00f, 0.00f, 0.02f},
                                           {0.21f, 0.06f, 0.42f},
                                           {0.52f, 0.13f, 0.50f},
                                           {0.84f, 0.28f, 0.38f},
                                           {0.98f, 0.60f, 0.32f},
                                           {1.00f, 0.97f, 0.78f}}};

Color LinearColorAt(float share) {
  const float place = share > 0 ? std::min(share, 1.0f) * (kColors.size() - 1) : 0.0f;
  const size_t first = std::min(static_cast<size_t>(place), kColors.size() - 2);
  const float t = place - static_cast<float>(first);
  Color color;
  for (size_t c = 0; c < 3; ++c)
    color[c] = LinearFromSrgb(kColors[first][c] + t * (kColors[first + 1][c] - kColors[first][c]));
  return color;
}

}  // namespace

Plane StepErrors(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  LUMIFOLD_CHECK(picture[0].width() == reference[0].width() && picture[0].height() == reference[0].height());
  Plane errors(reference[0].width(), reference[0].height());
  ForEachPixel(errors.width(), errors.height(), [&](int x, int y) {
    float sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float step =
          SrgbFromLinear(exposure * picture[c].At(x, y)) - SrgbFromLinear(exposure * reference[c].At(x, y));
      sum += step * step;
    }
    errors.At(x, y) = 255.0f * std::sqrt(sum / 3.0f);
  });
  return errors;
}

float HeatScale(ConstFloatView values) {
  std::vector<float> sorted;
  for (int y = 0; y < values.height(); ++y)
    sorted.insert(sorted.end(), values.Row(y), values.Row(y) + values.width());
  LUMIFOLD_CHECK(!sorted.empty());
  const size_t above = sorted.size() / 1000;
  const auto at = sorted.end() - 1 - static_cast<std::ptrdiff_t>(above);
  std::nth_element(sorted.begin(), at, sorted.end());
  const auto reached = static_cast<double>(*at);
  if (!(reached > 0)) return 1;
  const double decade = std::pow(10.0, std::floor(std::log10(reached)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (reached <= step * decade) return static_cast<float>(step * decade);
  }
  return static_cast<float>(10 * decade);
}

Picture HeatMap(ConstFloatView values, float top) {
  Picture map;
  for (Plane& plane : map) plane = Plane(values.width(), values.height());
  ForEachPixel(values.width(), values.height(), [&](int x, int y) {
    const Color color = LinearColorAt(values.At(x, y) / top);
    for (size_t c = 0; c < 3; ++c) map[c].At(x, y) = color[c];
  });
  return map;
}

}  // namespace lumifold::metrics
