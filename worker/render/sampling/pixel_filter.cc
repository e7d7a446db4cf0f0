#include "worker/render/sampling/pixel_filter.h"

#include <utility>
#include <vector>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

/// The function at `x`, -0.5 to 0.5 of the width; its factor does not matter.
double Value(PixelFilter::Kind kind, float x) {
  if (kind == PixelFilter::Kind::kGaussian) {
    constexpr float kDeviation = 0.25f;
    return static_cast<double>(Exp(-0.5f * x * x / (kDeviation * kDeviation)));
  }
  float sine = 0;
  float cosine = 0;
  SinCos(2 * kPi * x, &sine, &cosine);
  const double c = static_cast<double>(cosine);
  const double twice = 2 * c * c - 1;
  const double thrice = c * (2 * twice - 1);
  return 0.35875 + 0.48829 * c + 0.14128 * twice + 0.01168 * thrice;
}

}  // namespace

PixelFilter::PixelFilter(Kind kind, float width) : width_(width) {
  if (kind == Kind::kBox) return;
  // The integral by the midpoint rule over one half, so that the table is symmetric to the bit.
  constexpr size_t kParts = 1 << 16;
  std::vector<double> integral(kParts + 1, 0.0);
  for (size_t i = 0; i < kParts; ++i) {
    const float middle = 0.5f * (static_cast<float>(i) + 0.5f) / kParts;
    integral[i + 1] = integral[i] + Value(kind, middle);
  }
  auto table = std::make_shared<Table>();
  constexpr size_t kCentre = kSteps / 2;
  size_t part = 0;
  for (size_t i = 0; i <= kCentre; ++i) {
    const double wanted = integral[kParts] * static_cast<double>(i) / kCentre;
    while (part + 1 < kParts && integral[part + 1] < wanted) ++part;
    const double inside = (wanted - integral[part]) / (integral[part + 1] - integral[part]);
    const auto distance =
        static_cast<float>((static_cast<double>(part) + inside) / (2 * kParts) * static_cast<double>(width));
    (*table)[kCentre + i] = distance;
    (*table)[kCentre - i] = -distance;
  }
  table_ = std::move(table);
}

}  // namespace lumifold::render
