#include "tests/charts/metrics/reference_noise.h"

#include "filter/image/check.h"
#include "filter/metrics/metrics.h"

namespace lumifold::metrics {

double Mse255Noise(const ConstColorView& half_a, const ConstColorView& half_b, float exposure) {
  return Mse255(half_a, half_b, exposure) / 4;
}

double RelMseNoise(const ConstColorView& half_a, const ConstColorView& half_b) {
  double total = 0;
  const int width = half_a[0].width();
  const int height = half_a[0].height();
  LUMIFOLD_CHECK(width > 0 && height > 0 && half_b[0].width() == width && half_b[0].height() == height);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      double row = 0;
      for (int x = 0; x < width; ++x) {
        const auto a = static_cast<double>(half_a[c].At(x, y));
        const auto b = static_cast<double>(half_b[c].At(x, y));
        const double mean = (a + b) / 2;
        row += (a - b) * (a - b) / 4 / (mean * mean + 0.01);
      }
      total += row;
    }
  }
  return total / (3.0 * width * height);
}

}  // namespace lumifold::metrics
