#include "filter/denoise/firefly.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "filter/kernels/box_mean.h"
#include "filter/layers/features.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 2;
constexpr size_t kMinNeighbours = 4;
constexpr int kNoiseRadius = 12;     // 25x25 window
constexpr int kSpreadHeight = 3;     // of the manifold tree: geometry and brightness vary little
constexpr float kSigmaLight = 1.7f;  // of a channel, stabilised

/// The bound: twice the 75th percentile of the valid pixels of the window; infinity where there are too few.
/// `luminance`: from PaddedLuminance().
float BoundAt(const Plane& luminance, int x, int y) {
  std::array<float, (2 * kRadius + 1) * (2 * kRadius + 1)> values;
  size_t count = 0;
  for (int j = 0; j <= 2 * kRadius; ++j) {
    for (int i = 0; i <= 2 * kRadius; ++i) {
      const float value = luminance.At(x + i, y + j);
      if (value < INFINITY) values[count++] = value;
    }
  }
  if (count < kMinNeighbours) return INFINITY;
  const auto quartile = values.begin() + static_cast<std::ptrdiff_t>(3 * count / 4);
  std::nth_element(values.begin(), quartile, values.begin() + static_cast<std::ptrdiff_t>(count));
  return 2.0f * *quartile;
}

/// For each pixel of a row: whether over three quarters of its valid neighbours are below half of
/// `brighter[x]`, the luminance of the brighter half, so that it is above BoundAt(). `luminance`: from
/// PaddedLuminance().
void FindOutliers(const Plane& luminance, const std::vector<float>& brighter, int y,
                  std::vector<uint8_t>* is_outlier) {
  const size_t width = brighter.size();
  std::vector<int32_t> below(width, 0);
  std::vector<int32_t> valid(width, 0);
  for (int j = 0; j <= 2 * kRadius; ++j) {
    for (int i = 0; i <= 2 * kRadius; ++i) {
      const float* __restrict neighbour = luminance.Row(y + j) + i;
      for (size_t x = 0; x < width; ++x) {
        below[x] += 2.0f * neighbour[x] < brighter[x] ? 1 : 0;
        valid[x] += neighbour[x] < INFINITY ? 1 : 0;
      }
    }
  }
  for (size_t x = 0; x < width; ++x) (*is_outlier)[x] = below[x] > 3 * valid[x] / 4 ? 1 : 0;
}

/// Luminance of `color` with an apron of kRadius on all sides; infinite where `weight` is 0 and in the apron.
Plane PaddedLuminance(const Planes& color, const Plane& weight, TaskPool* pool) {
  Plane padded(weight.width() + 2 * kRadius, weight.height() + 2 * kRadius);
  padded.Fill(INFINITY);
  ForEachBand(pool, weight.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      float* row = padded.Row(y + kRadius) + kRadius;
      for (int x = 0; x < weight.width(); ++x) {
        if (weight.At(x, y) > 0) row[x] = LuminanceAt(color, x, y);
      }
    }
  });
  return padded;
}

/// Standard deviation of one half relative to its light, around each pixel. The ratio of the halves'
/// difference to their sum is bounded, so that no pixel dominates the mean.
Plane RelativeNoise(const Halves& halves, TaskPool* pool) {
  Planes square = MakePlanes(1, halves.width(), halves.height());
  ForEachPixel(pool, halves.width(), halves.height(), [&](int x, int y) {
    const float a = LuminanceAt(halves.a, x, y);
    const float b = LuminanceAt(halves.b, x, y);
    const float ratio = (a - b) / (a + b);
    if (ratio >= -1 && ratio <= 1) square[0].At(x, y) = 2 * ratio * ratio;
  });
  Plane noise = std::move(BoxMeans(square, halves.weight.view(), kNoiseRadius, pool)[0]);
  ForEachPixel(noise.width(), noise.height(),
               [&](int x, int y) { noise.At(x, y) = std::sqrt(noise.At(x, y)); });
  return noise;
}

/// Whether the pixel is over twice as bright as each valid neighbour. `luminance`: from PaddedLuminance().
bool IsIsolated(const Plane& luminance, int x, int y) {
  const float half = 0.5f * luminance.At(x + kRadius, y + kRadius);
  for (int j = 0; j <= 2 * kRadius; ++j) {
    for (int i = 0; i <= 2 * kRadius; ++i) {
      const float value = luminance.At(x + i, y + j);
      if (value < INFINITY && value > half && (i != kRadius || j != kRadius)) return false;
    }
  }
  return true;
}

/// Scales the half's pixel to `bound` if it is an outlier; adds `share` times what it loses to `removed`.
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
  if (!halves->has_noise_estimate || halves->is_difference) return {};
  const int width = halves->width();
  const int height = halves->height();
  const Plane luminance =
      PaddedLuminance(Combine(halves->a, halves->b, halves->share_a.view(), pool), halves->weight, pool);
  const Plane noise = RelativeNoise(*halves, pool);
  Planes removed = MakePlanes(3, width, height);
  std::atomic<bool> is_any{false};
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    bool is_any_here = false;
    std::vector<float> brighter(static_cast<size_t>(width));
    std::vector<uint8_t> is_outlier(brighter.size());
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width; ++x)
        brighter[static_cast<size_t>(x)] =
            std::max(LuminanceAt(halves->a, x, y), LuminanceAt(halves->b, x, y));
      FindOutliers(luminance, brighter, y, &is_outlier);
      for (int x = 0; x < width; ++x) {
        if (is_outlier[static_cast<size_t>(x)] == 0 ||
            halves->weight_a.At(x, y) * halves->weight_b.At(x, y) == 0)
          continue;
        const float bound = BoundAt(luminance, x, y);
        const float difference = LuminanceAt(halves->a, x, y) - LuminanceAt(halves->b, x, y);
        float sigma = std::abs(difference) * 0.70710678f;  // of one half
        // Where both halves have hit a firefly they hardly differ; the window around shows the noise.
        if (IsIsolated(luminance, x, y))
          sigma = std::max(sigma, noise.At(x, y) * brighter[static_cast<size_t>(x)]);
        const float share = halves->share_a.At(x, y);
        is_any_here |= Suppress(&halves->a, bound, sigma, share, x, y, &removed);
        is_any_here |= Suppress(&halves->b, bound, sigma, 1.0f - share, x, y, &removed);
      }
    }
    if (is_any_here) is_any = true;
  });
  return is_any ? std::move(removed) : Planes{};
}

int FireflyWindow() { return kNoiseRadius; }

Planes SpreadRemoved(const Planes& removed, const Planes& light, const Planes& geometry,
                     ConstFloatView weight, TaskPool* pool) {
  Planes guide;
  for (const Plane& feature : geometry) guide.push_back(feature.Clone());
  for (const Plane& channel : light) AppendFeature(channel.view(), kSigmaLight, weight, &guide);
  ManifoldParams params;
  params.sigma_s = kSpreadReachPx;
  params.height = kSpreadHeight;
  return ManifoldFilter(removed, guide, weight, params, pool);
}

}  // namespace lumifold::filter
