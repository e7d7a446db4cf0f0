#include "filter/denoise/convergence.h"

#include <algorithm>
#include <utility>

#include "filter/kernels/box_mean.h"
#include "filter/layers/magnitude.h"

namespace lumifold::filter {
namespace {

constexpr float kShrink = 4.0f;   // c: residuals up to this many variances count as noise
constexpr int kShrinkRadius = 2;  // 5x5 window
/// Where few samples find most of the light, small windows that none has hit are dark and seem free of noise.
constexpr int kNoiseRadius = 12;  // 25x25 window
/// Sample count up to which the wide window counts in full; beyond, its weight falls as 1/n, or it would keep
/// the picture from converging beside lights.
constexpr float kWideWindowSamples = 16;

/// 1 where both halves have samples, else 0.
Plane BothHalvesMask(const Frame& frame) {
  Plane mask(frame.width, frame.height);
  ForEachPixel(frame.width, frame.height,
               [&](int x, int y) { mask.At(x, y) = frame.samples.HasBoth(x, y) ? 1.0f : 0.0f; });
  return mask;
}

/// Variance of C, and (C - F)^2, summed over the channels and in units of the mean brightness squared, so
/// that neither tiny nor huge scenes leave the range of floats.
Planes MeasureResidual(const Frame& frame, const Picture& picture, float unit, TaskPool* pool) {
  Planes residual = MakePlanes(2, frame.width, frame.height);
  const HalvedLayer& combined = frame.combined;
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      const float difference = (UsableOr0(combined.a[c].At(x, y)) - UsableOr0(combined.b[c].At(x, y))) / unit;
      residual[0].At(x, y) += frame.samples.VarianceFactor(x, y) * difference * difference;
      const float off = (UsableOr0(combined.mean[c].At(x, y)) - picture[c].At(x, y)) / unit;
      residual[1].At(x, y) += off * off;
    });
  }
  return residual;
}

/// Weight of the wide window's variance with n samples.
float WideWindowWeight(float n) { return kWideWindowSamples / std::max(n, kWideWindowSamples); }

/// Bounds each pixel's (C - F)^2, so that at few samples it takes two pixels to draw a window back: a firefly
/// that both halves have hit seems free of noise.
void CapSquares(const Frame& frame, const Plane& wide_variance, Plane* squares) {
  constexpr float kWindow = (2 * kShrinkRadius + 1) * (2 * kShrinkRadius + 1);
  ForEachPixel(frame.width, frame.height, [&](int x, int y) {
    const float cap = kWindow * kShrink * wide_variance.At(x, y) / WideWindowWeight(frame.samples.At(x, y));
    squares->At(x, y) = std::min(squares->At(x, y), cap);
  });
}

}  // namespace

int ShrinkWindow() { return kNoiseRadius + kShrinkRadius; }

void ShrinkResidual(const Frame& frame, TaskPool* pool, Picture* picture) {
  const float unit = MeanMagnitude(frame.combined.mean, pool);
  if (!(unit > 0)) return;
  const Plane mask = BothHalvesMask(frame);
  Planes residual = MeasureResidual(frame, *picture, unit, pool);
  Plane squares = std::move(residual.back());
  residual.pop_back();
  const Plane wide_variance = std::move(BoxMeans(residual, mask.view(), kNoiseRadius, pool).front());
  CapSquares(frame, wide_variance, &squares);
  residual.push_back(std::move(squares));
  const Planes means = BoxMeans(residual, mask.view(), kShrinkRadius, pool);
  const Plane& variance = means[0];
  const Plane& square = means[1];
  const ConstColorView& noisy = frame.combined.mean;
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    const float wide_weight = WideWindowWeight(frame.samples.At(x, y));
    const float noise = kShrink * std::max(variance.At(x, y), wide_weight * wide_variance.At(x, y));
    if (mask.At(x, y) == 0 || !(square.At(x, y) > noise)) return;
    const float back = 1.0f - noise / square.At(x, y);
    for (size_t c = 0; c < 3; ++c) {
      float& value = (*picture)[c].At(x, y);
      if (IsUsable(noisy[c].At(x, y))) value += back * (noisy[c].At(x, y) - value);
    }
  });
}

}  // namespace lumifold::filter
