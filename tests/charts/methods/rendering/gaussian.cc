#include "tests/charts/methods/rendering/gaussian.h"

#include <algorithm>
#include <cmath>

#include "filter/image/planes.h"
#include "filter/image/portable_math.h"

namespace lumifold::charts {

Gaussian::Gaussian(float sigma_px, int width, int height)
    : radius_(static_cast<int>(std::ceil(3 * sigma_px))),
      columns_(Weights(sigma_px, radius_, width)),
      rows_(Weights(sigma_px, radius_, height)),
      squared_columns_(Squared(columns_)),
      squared_rows_(Squared(rows_)) {}

Plane Gaussian::Weights(float sigma_px, int radius, int length) {
  Plane weights(2 * radius + 1, length);
  for (int i = 0; i < length; ++i) {
    float sum = 0;
    for (int k = -radius; k <= radius; ++k) {
      if (i + k < 0 || i + k >= length) continue;
      const float sigmas = k == 0 ? 0.0f : static_cast<float>(k) / sigma_px;
      weights.At(k + radius, i) = Exp(-0.5f * sigmas * sigmas);
      sum += weights.At(k + radius, i);
    }
    for (int k = 0; k <= 2 * radius; ++k) weights.At(k, i) /= sum;
  }
  return weights;
}

Plane Gaussian::Squared(const Plane& weights) {
  Plane squared(weights.width(), weights.height());
  ForEachPixel(weights.width(), weights.height(),
               [&](int x, int y) { squared.At(x, y) = weights.At(x, y) * weights.At(x, y); });
  return squared;
}

Plane Gaussian::Convolve(const Plane& values, const Plane& columns, const Plane& rows, TaskPool* pool) const {
  const int width = values.width();
  const int height = values.height();
  Plane across(width, height);
  ParallelFor(pool, height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < width; ++x) {
      float sum = 0;
      for (int u = std::max(0, x - radius_); u <= std::min(width - 1, x + radius_); ++u)
        sum += columns.At(u - x + radius_, x) * values.At(u, y);
      across.At(x, y) = sum;
    }
  });
  Plane out(width, height);
  ParallelFor(pool, height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    for (int v = std::max(0, y - radius_); v <= std::min(height - 1, y + radius_); ++v) {
      const float weight = rows.At(v - y + radius_, y);
      for (int x = 0; x < width; ++x) out.At(x, y) += weight * across.At(x, v);
    }
  });
  return out;
}

}  // namespace lumifold::charts
