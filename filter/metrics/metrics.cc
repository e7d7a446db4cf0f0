#include "filter/metrics/metrics.h"

#include <cmath>

#include "absl/functional/function_ref.h"
#include "filter/image/check.h"
#include "filter/image/color.h"

namespace lumifold::metrics {
namespace {

/// Mean of error(x, r) over all pixels and channels; rows are summed on their own first, to lose no small
/// errors in a large sum.
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
  return MeanError(picture, reference, [](float x, float r) {
    const double difference = static_cast<double>(x) - static_cast<double>(r);
    return difference * difference / (static_cast<double>(r) * static_cast<double>(r) + 0.01);
  });
}

}  // namespace lumifold::metrics
