#include "filter/manifold/features.h"

#include <cmath>

#include "filter/image/layers.h"
#include "filter/image/portable_math.h"
#include "filter/manifold/row_kernels.h"

namespace lumifold::filter {
namespace {

constexpr float kSigmaNormal = 0.3f;  // chord between unit normals: 10 degrees are 0.58 sigma
constexpr float kSigmaLogDepth = 0.05f;

/// x where it is a number, else 0: features must be finite everywhere.
float FiniteOr0(float x) { return std::abs(x) < 1e6f ? x : 0.0f; }

}  // namespace

Planes GeometryFeatures(const LayeredImage& film, ConstFloatView validity, TaskPool* pool) {
  const std::array<ConstFloatView, 3> normal = {film.Get(layers::kNormalX), film.Get(layers::kNormalY),
                                                film.Get(layers::kNormalZ)};
  const ConstFloatView distance = film.Get(layers::kDistance);
  Planes features = MakePlanes(4, film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (validity.At(x, y) == 0) continue;
        for (size_t k = 0; k < 3; ++k) features[k].At(x, y) = FiniteOr0(normal[k].At(x, y) / kSigmaNormal);
        features[3].At(x, y) = FiniteOr0(Log(distance.At(x, y)) / kSigmaLogDepth);
      }
    }
  });
  return features;
}

Planes Stabilise(const Planes& color, float knee, float origin, TaskPool* pool) {
  const float shift = Asinh(origin * (1.0f / knee));
  const int height = color[0].height();
  Planes stable = MakePlanes(color.size(), color[0].width(), height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (size_t c = 0; c < color.size(); ++c) {
      for (int y = y0; y < y1; ++y)
        StabiliseRow(color[c].Row(y), 1.0f / knee, shift, color[c].width(), stable[c].Row(y));
    }
  });
  return stable;
}

Planes JointFeatures(const Planes& color, const PatchBasis& basis, float sigma_q, const Planes& geometry,
                     TaskPool* pool) {
  PatchBasis scaled = basis;
  for (float& tap : scaled.kernels) tap /= sigma_q;
  Planes features = ProjectPatches(color, scaled, pool);
  for (const Plane& plane : geometry) features.push_back(plane.Clone());
  return features;
}

}  // namespace lumifold::filter
