#include "filter/metrics/metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "absl/functional/function_ref.h"
#include "filter/image/check.h"
#include "filter/image/color.h"
#include "filter/image/planes.h"

namespace lumifold::metrics {
namespace {

/// Mean of error(x, r) over all pixels and channels. Each row is summed separately, so that small errors are
/// not lost in a large sum.
double MeanError(const ConstColorView& picture, const ConstColorView& reference,
                 absl::FunctionRef<double(float, float)> error) {
  const int width = reference[0].width();
  const int height = reference[0].height();
  LUMIFOLD_CHECK(width > 0 && height > 0);
  double total = 0;
  for (size_t c = 0; c < 3; ++c) {
    LUMIFOLD_CHECK(picture[c].width() == width && picture[c].height() == height);
    for (int y = 0; y < height; ++y) {
      double row = 0;
      for (int x = 0; x < width; ++x) row += error(picture[c].At(x, y), reference[c].At(x, y));
      total += row;
    }
  }
  return total / (3.0 * width * height);
}

/// (x - r)^2 / (r^2 + 0.01).
double RelativeSquare(float x, float r) {
  const double difference = static_cast<double>(x) - static_cast<double>(r);
  return difference * difference / (static_cast<double>(r) * static_cast<double>(r) + 0.01);
}

}  // namespace

double Mse255(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  return MeanError(picture, reference, [exposure](float x, float r) {
    const double step =
        255.0 * static_cast<double>(SrgbFromLinear(exposure * x) - SrgbFromLinear(exposure * r));
    return step * step;
  });
}

double Psnr(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  return 10.0 * std::log10(255.0 * 255.0 / Mse255(picture, reference, exposure));
}

double RelMse(const ConstColorView& picture, const ConstColorView& reference) {
  return MeanError(picture, reference, RelativeSquare);
}

double TrimmedRelMse(const ConstColorView& picture, const ConstColorView& reference) {
  constexpr size_t kPixelsPerTrimmed = 1000;
  const int width = reference[0].width();
  const int height = reference[0].height();
  LUMIFOLD_CHECK(width > 0 && height > 0 && picture[0].width() == width && picture[0].height() == height);
  std::vector<double> errors;
  ForEachPixel(width, height, [&](int x, int y) {
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) sum += RelativeSquare(picture[c].At(x, y), reference[c].At(x, y)) / 3.0;
    errors.push_back(std::isnan(sum) ? std::numeric_limits<double>::infinity() : sum);
  });
  std::sort(errors.begin(), errors.end());
  errors.resize(errors.size() - errors.size() / kPixelsPerTrimmed);
  return std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size());
}

}  // namespace lumifold::metrics
