#include "tests/charts/methods/samples/guided_rays.h"

#include "filter/baselines/guided.h"
#include "filter/baselines/standardise.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/layers/filter_layers.h"
#include "filter/layers/halves.h"

namespace lumifold::charts {
namespace {

/// The light of the guide rays, 3 planes.
Planes GuideLight(const LayeredImage& guide) {
  const ConstColorView direct = guide.GetColor(layers::kDirect);
  const ConstColorView indirect = guide.GetColor(layers::kIndirect);
  Planes light = MakePlanes(3, guide.width(), guide.height());
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(guide.width(), guide.height(),
                 [&](int x, int y) { light[c].At(x, y) = direct[c].At(x, y) + indirect[c].At(x, y); });
  }
  return light;
}

absl::StatusOr<Picture> FilterByGuideRays(const SampleSet& set, absl::Span<const float> values,
                                          TaskPool* pool) {
  const Planes light = GuideLight(set.guide);
  const auto filter_layer = [&](const filter::Halves& halves, const Planes& geometry) {
    Planes guide = Clone(geometry);
    if (halves.width() == set.width && halves.height() == set.height) {
      for (const Plane& plane : light) guide.push_back(plane.Clone());
    }
    const ConstFloatView mask = halves.weight.view();
    guide = filter::Standardise(guide, mask, true, pool).planes;
    const Planes mean = filter::Combine(halves.a, halves.b, halves.share_a.view(), pool);
    return filter::GuidedFilter(mean, guide, mask, static_cast<int>(values[0]),
                                static_cast<double>(values[1]), pool);
  };
  return filter::FilterLayers(*set.film, filter_layer, pool);
}

}  // namespace

SampleMethod GuidedRaysMethod() {
  return {
      .info =
          {.name = "guided-rays",
           .summary = "guided filter on each layer of light, by normals, depth and one guide path per pixel",
           .source = "He et al. 2010; Bauszat et al. 2011",
           .parameters =
               {{"radius", "of the windows, in pixels", 12, {2, 4, 8, 12, 24}, 1, 256},
                {"epsilon", "ridge, over the guide's variance", 1e-3f, {1e-4f, 1e-3f, 1e-2f}, 1e-6f, 10}}},
      .uses_samples = false,
      .uses_guide = true,
      .filter = FilterByGuideRays};
}

}  // namespace lumifold::charts
