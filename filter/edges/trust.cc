#include "filter/edges/trust.h"

#include <algorithm>
#include <cmath>

#include "filter/image/layers.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/error_weight.h"
#include "filter/layers/recombine.h"

namespace lumifold::filter {
namespace {

/// Of the pixels in the mask, summed over the channels and weighed by ErrorWeight(): (values - C)^2 and the
/// variance of C.
Planes SquaresIn(const Planes& values, const Plane& mask, const LayeredImage& film, TaskPool* pool) {
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  const ConstColorView a = film.GetColor(layers::HalfA(layers::kNoisy));
  const ConstColorView b = film.GetColor(layers::HalfB(layers::kNoisy));
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  constexpr float kDark = 1e-30f;  // of a picture without light
  const float per_light = 1.0f / (3.0f * std::max(MeanMagnitude(noisy, pool), kDark));
  Planes squares = MakePlanes(2, film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (mask.At(x, y) <= 0) continue;
        float light = 0;
        for (const Plane& channel : values) light += per_light * std::abs(channel.At(x, y));
        const float weight = ErrorWeight(light);
        const float n = std::max(1.0f, n_a.At(x, y) + n_b.At(x, y));
        const float share = weight * n_a.At(x, y) * n_b.At(x, y) / (n * n);
        for (size_t c = 0; c < 3; ++c) {
          const float difference = a[c].At(x, y) - b[c].At(x, y);
          const float off = values[c].At(x, y) - noisy[c].At(x, y);
          squares[0].At(x, y) += weight * off * off;
          squares[1].At(x, y) += share * difference * difference;
        }
      }
    }
  });
  return squares;
}

}  // namespace

Plane TrustIn(const Planes& values, const Plane& mask, const LayeredImage& film, const TrustParams& params,
              TaskPool* pool) {
  const Planes means = BoxMeans(SquaresIn(values, mask, film, pool), mask.view(), params.radius, pool);
  Plane trust(film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (mask.At(x, y) <= 0) continue;
        const float left = params.noise_left * means[1].At(x, y);
        const float bias = std::max(0.0f, means[0].At(x, y) - means[1].At(x, y));
        trust.At(x, y) = left + bias > 0 ? left / (left + bias) : 0.0f;
      }
    }
  });
  return trust;
}

}  // namespace lumifold::filter
