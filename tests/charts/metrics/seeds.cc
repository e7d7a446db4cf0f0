#include "tests/charts/metrics/seeds.h"

#include "filter/image/check.h"
#include "filter/image/color.h"

namespace lumifold::metrics {

absl::StatusOr<SeedError> MeasureSeeds(absl::Span<const ConstColorView> pictures,
                                       const ConstColorView& reference, float exposure) {
  if (pictures.size() < 2) return absl::InvalidArgumentError("seed variance needs at least two pictures");
  const int width = reference[0].width();
  const int height = reference[0].height();
  LUMIFOLD_CHECK(width > 0 && height > 0);
  for (const ConstColorView& picture : pictures)
    LUMIFOLD_CHECK(picture[0].width() == width && picture[0].height() == height);
  const auto count = static_cast<double>(pictures.size());
  const auto shown = [exposure](const ConstColorView& color, size_t c, int x, int y) {
    return 255.0 * static_cast<double>(SrgbFromLinear(exposure * color[c].At(x, y)));
  };
  SeedError error;
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      SeedError row;
      for (int x = 0; x < width; ++x) {
        double mean = 0;
        for (const ConstColorView& picture : pictures) mean += shown(picture, c, x, y) / count;
        double variance = 0;
        for (const ConstColorView& picture : pictures) {
          const double off = shown(picture, c, x, y) - mean;
          variance += off * off / (count - 1);
        }
        const double bias = mean - shown(reference, c, x, y);
        row.variance += variance;
        row.bias_squared += bias * bias - variance / count;
      }
      error.variance += row.variance;
      error.bias_squared += row.bias_squared;
    }
  }
  const double values = 3.0 * width * height;
  return SeedError{error.variance / values, error.bias_squared / values};
}

}  // namespace lumifold::metrics
