#include "filter/edges/trust.h"

#include <algorithm>
#include <cmath>

#include "filter/kernels/box_mean.h"
#include "filter/layers/error_weight.h"
#include "filter/layers/magnitude.h"

namespace lumifold::filter {
namespace {

/// At the pixels of the mask, summed over the channels and weighted by ErrorWeight(): (values - C)^2 and the
/// variance of C.
Planes SquaresIn(const Planes& values, const Plane& mask, const Frame& frame, TaskPool* pool) {
  const HalvedLayer& c_layer = frame.combined;
  constexpr float kDark = 1e-30f;  // mean of a picture without light
  const float per_light = 1.0f / (3.0f * std::max(MeanMagnitude(c_layer.mean, pool), kDark));
  Planes squares = MakePlanes(2, frame.width, frame.height);
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    if (mask.At(x, y) <= 0) return;
    float light = 0;
    for (const Plane& channel : values) light += per_light * std::abs(channel.At(x, y));
    const float weight = ErrorWeight(light);
    const float factor = frame.samples.VarianceFactor(x, y, weight);
    for (size_t c = 0; c < 3; ++c) {
      const float difference = c_layer.a[c].At(x, y) - c_layer.b[c].At(x, y);
      const float off = values[c].At(x, y) - c_layer.mean[c].At(x, y);
      squares[0].At(x, y) += weight * off * off;
      squares[1].At(x, y) += factor * difference * difference;
    }
  });
  return squares;
}

}  // namespace

Plane TrustIn(const Planes& values, const Plane& mask, const Frame& frame, const TrustParams& params,
              TaskPool* pool) {
  const Planes means = BoxMeans(SquaresIn(values, mask, frame, pool), mask.view(), params.radius, pool);
  Plane trust(frame.width, frame.height);
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    if (mask.At(x, y) <= 0) return;
    const float variance = params.competing_variance * means[1].At(x, y);
    const float bias = std::max(0.0f, means[0].At(x, y) - means[1].At(x, y));
    trust.At(x, y) = variance + bias > 0 ? variance / (variance + bias) : 0.0f;
  });
  return trust;
}

void Follow(const Planes& values, const Plane& share, TaskPool* pool, Picture* picture) {
  ForEachPixel(pool, share.width(), share.height(), [&](int x, int y) {
    if (!(share.At(x, y) > 0)) return;
    for (size_t c = 0; c < 3; ++c) {
      float& out = (*picture)[c].At(x, y);
      if (std::isfinite(values[c].At(x, y))) out += share.At(x, y) * (values[c].At(x, y) - out);
    }
  });
}

}  // namespace lumifold::filter
