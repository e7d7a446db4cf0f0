#include "tests/charts/metrics/blotch.h"

#include <array>
#include <limits>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/color.h"

namespace lumifold::metrics {
namespace {

constexpr int kBlock = 8;

/// Luminance and two chroma differences.
using Opponent = std::array<double, 3>;

Opponent Shown(const ConstColorView& color, int x, int y, float exposure) {
  const float r = SrgbFromLinear(exposure * color[0].At(x, y));
  const float g = SrgbFromLinear(exposure * color[1].At(x, y));
  const float b = SrgbFromLinear(exposure * color[2].At(x, y));
  const float luminance = Luminance(r, g, b);
  return {static_cast<double>(luminance), static_cast<double>(r - luminance),
          static_cast<double>(b - luminance)};
}

/// The variance of the error's block means in each opponent channel.
Opponent BlockVariance(const ConstColorView& picture, const ConstColorView& reference, float exposure) {
  Opponent sum = {};
  Opponent square = {};
  const int columns = reference[0].width() / kBlock;
  const int rows = reference[0].height() / kBlock;
  for (int block = 0; block < columns * rows; ++block) {
    Opponent mean = {};
    for (int i = 0; i < kBlock * kBlock; ++i) {
      const int x = block % columns * kBlock + i % kBlock;
      const int y = block / columns * kBlock + i / kBlock;
      const Opponent a = Shown(picture, x, y, exposure);
      const Opponent b = Shown(reference, x, y, exposure);
      for (size_t c = 0; c < 3; ++c) mean[c] += (a[c] - b[c]) / (kBlock * kBlock);
    }
    for (size_t c = 0; c < 3; ++c) {
      sum[c] += mean[c];
      square[c] += mean[c] * mean[c];
    }
  }
  const double count = static_cast<double>(columns) * rows;
  Opponent variance;
  for (size_t c = 0; c < 3; ++c) variance[c] = square[c] / count - sum[c] * sum[c] / (count * count);
  return variance;
}

double Ratio(double filtered, double noisy) {
  constexpr double kRounding = 1e-14;  // variance of displayed values that rounding explains
  if (filtered <= kRounding) return 0;
  return noisy > kRounding ? filtered / noisy : std::numeric_limits<double>::infinity();
}

}  // namespace

absl::StatusOr<Blotch> MeasureBlotch(const ConstColorView& filtered, const ConstColorView& noisy,
                                     const ConstColorView& reference, float exposure) {
  const int width = reference[0].width();
  const int height = reference[0].height();
  for (const ConstColorView& picture : {filtered, noisy})
    LUMIFOLD_CHECK(picture[0].width() == width && picture[0].height() == height);
  if ((width / kBlock) * (height / kBlock) < 2)
    return absl::InvalidArgumentError("the blotch index needs two blocks of 8x8 pixels");
  const Opponent after = BlockVariance(filtered, reference, exposure);
  const Opponent before = BlockVariance(noisy, reference, exposure);
  return Blotch{Ratio(after[0], before[0]), Ratio(after[1] + after[2], before[1] + before[2])};
}

}  // namespace lumifold::metrics
