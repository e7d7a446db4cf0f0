#include "filter/layers/features.h"

#include "filter/image/portable_math.h"
#include "filter/kernels/row_kernels.h"
#include "filter/manifold/layer_call.h"

namespace lumifold::filter {
namespace {

float FeatureOr0(float x) { return UsableOr0(x, kLargestFeature); }

}  // namespace

std::array<float, kGeometryFeatures> GeometryFeature(const std::array<float, 3>& normal, float distance,
                                                     const GeometryRanges& ranges) {
  return {FeatureOr0(normal[0] / ranges.normal), FeatureOr0(normal[1] / ranges.normal),
          FeatureOr0(normal[2] / ranges.normal), FeatureOr0(Log(distance) / ranges.log_depth)};
}

Planes GeometryFeatures(const GeometryViews& geometry, ConstFloatView validity, const GeometryRanges& ranges,
                        TaskPool* pool) {
  Planes features = MakePlanes(kGeometryFeatures, validity.width(), validity.height());
  const ConstColorView& n = geometry.normal;
  ForEachPixel(pool, validity.width(), validity.height(), [&](int x, int y) {
    if (validity.At(x, y) == 0) return;
    const auto u =
        GeometryFeature({n[0].At(x, y), n[1].At(x, y), n[2].At(x, y)}, geometry.distance.At(x, y), ranges);
    for (size_t k = 0; k < u.size(); ++k) features[k].At(x, y) = u[k];
  });
  return features;
}

void AppendFeature(ConstFloatView value, float sigma, ConstFloatView validity, Planes* features) {
  Plane& feature = features->emplace_back(validity.width(), validity.height());
  ForEachPixel(validity.width(), validity.height(), [&](int x, int y) {
    feature.At(x, y) = validity.At(x, y) > 0 ? FeatureOr0(value.At(x, y) / sigma) : 0.0f;
  });
}

Planes Stabilise(const Planes& color, float knee, float origin, TaskPool* pool) {
  const float shift = Asinh(origin * (1.0f / knee));
  const int height = color[0].height();
  Planes stable = MakeUninitializedPlanes(color.size(), color[0].width(), height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (size_t c = 0; c < color.size(); ++c) {
      for (int y = y0; y < y1; ++y)
        StabiliseRow(color[c].Row(y), 1.0f / knee, shift, color[c].width(), stable[c].Row(y));
    }
  });
  return stable;
}

}  // namespace lumifold::filter
