#include "filter/manifold/firefly.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "filter/image/color.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 2;
constexpr size_t kLeastNeighbours = 4;

float LuminanceAt(const Planes& color, int x, int y) {
  return Luminance(color[0].At(x, y), color[1].At(x, y), color[2].At(x, y));
}

/// Twice the 75th percentile of the valid neighbours, the pixel among them; infinity where too few are valid
/// to judge.
float BrightestExpected(const Plane& luminance, const Plane& weight, int x, int y) {
  std::array<float, (2 * kRadius + 1) * (2 * kRadius + 1)> values;
  size_t count = 0;
  for (int j = std::max(0, y - kRadius); j <= std::min(luminance.height() - 1, y + kRadius); ++j) {
    for (int i = std::max(0, x - kRadius); i <= std::min(luminance.width() - 1, x + kRadius); ++i) {
      if (weight.At(i, j) > 0) values[count++] = luminance.At(i, j);
    }
  }
  if (count < kLeastNeighbours) return INFINITY;
  const auto quartile = values.begin() + static_cast<std::ptrdiff_t>(3 * count / 4);
  std::nth_element(values.begin(), quartile, values.begin() + static_cast<std::ptrdiff_t>(count));
  return 2.0f * *quartile;
}

/// Scales the half's pixel to `bound` if it is an outlier; what it loses, times `share`, goes to `removed`.
bool Suppress(Planes* half, float bound, float sigma, float share, int x, int y, Planes* removed) {
  const float luminance = LuminanceAt(*half, x, y);
  if (!(luminance > bound) || !(luminance - 3.0f * sigma < bound) || !(bound >= 0)) return false;
  const float keep = bound / luminance;
  for (size_t c = 0; c < 3; ++c) {
    float& value = (*half)[c].At(x, y);
    (*removed)[c].At(x, y) += share * (1.0f - keep) * value;
    value *= keep;
  }
  return true;
}

}  // namespace

Planes SuppressFireflies(Halves* halves, TaskPool* pool) {
  if (!halves->has_noise_estimate) return {};
  const int width = halves->width();
  const int height = halves->height();
  const Planes mean = Combine(halves->a, halves->b, halves->share_a.view(), pool);
  Plane luminance(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) luminance.At(x, y) = LuminanceAt(mean, x, y);
  }
  Planes removed = MakePlanes(3, width, height);
  std::atomic<bool> is_any{false};
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    bool is_any_here = false;
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width; ++x) {
        if (halves->weight_a.At(x, y) * halves->weight_b.At(x, y) == 0) continue;
        const float bound = BrightestExpected(luminance, halves->weight, x, y);
        const float difference = LuminanceAt(halves->a, x, y) - LuminanceAt(halves->b, x, y);
        const float sigma = std::abs(difference) * 0.70710678f;  // of one half
        const float share = halves->share_a.At(x, y);
        is_any_here |= Suppress(&halves->a, bound, sigma, share, x, y, &removed);
        is_any_here |= Suppress(&halves->b, bound, sigma, 1.0f - share, x, y, &removed);
      }
    }
    if (is_any_here) is_any = true;
  });
  return is_any ? std::move(removed) : Planes{};
}

}  // namespace lumifold::filter
