#include "filter/layers/guide.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "filter/image/portable_math.h"
#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

PatchProjection ProjectionOf(const GuidedFiltering& filtering) {
  const JointGuide& guide = filtering.guide;
  PatchProjection patches = {ViewsOf(guide.color), guide.basis.radius, guide.basis.dimensions,
                             guide.basis.kernels, filtering.scale};
  if (guide.of.color == nullptr) return patches;
  patches.color = ViewsOf(*guide.of.color);  // which other calls have, too
  patches.inverse_knee = 1.0f / guide.of.knee;
  patches.shift = Asinh(guide.of.origin * patches.inverse_knee);
  return patches;
}

/// nullopt: the processor filters.
std::optional<std::vector<ManifoldResult>> FilterOnDevice(absl::Span<const GuidedFiltering> filterings,
                                                          const ManifoldParams& params, float reach,
                                                          TaskPool* pool) {
  FilterDevice* const device = DeviceOf(pool);
  if (device == nullptr) return std::nullopt;
  for (const GuidedFiltering& filtering : filterings) {
    if (filtering.mask.width() == 0 || filtering.mask.height() == 0) return std::nullopt;
  }
  return device->Filter(CallsOf(filterings, params, reach));
}

/// Multiplies the coordinates of patches, which come before the geometry.
void ScalePatches(float by, size_t geometry, TaskPool* pool, Planes* features) {
  for (size_t k = 0; k + geometry < features->size(); ++k) {
    Plane& plane = (*features)[k];
    ForEachPixel(pool, plane.width(), plane.height(), [&](int x, int y) { plane.At(x, y) *= by; });
  }
}

}  // namespace

Guide MakeGuide(const Halves& halves, const Planes& a, const Planes& b, float knee, TaskPool* pool) {
  const float level = halves.level;
  return {Stabilise(a, knee * level, level, pool),
          Stabilise(b, knee * level, level, pool),
          {&a, knee * level, level},
          {&b, knee * level, level}};
}

float NoiseOfHalf(const Halves& halves, const Guide& guide, TaskPool* pool) {
  constexpr float kHalfOverMean = 1.41421356f;
  constexpr float kLeast = 1e-4f;
  return std::max(kHalfOverMean * NoiseLevel(halves, guide.a, guide.b, pool), kLeast);
}

JointGuide MakeJointGuide(Planes color, const PatchBasis& basis, float sigma_q,
                          absl::Span<const Plane> geometry) {
  JointGuide guide = {std::move(color), basis, geometry};
  for (float& tap : guide.basis.kernels) tap /= sigma_q;
  return guide;
}

JointGuides MakeJointGuides(Guide guide, const Halves& halves, const PatchParams& patches, float sigma_q,
                            absl::Span<const Plane> geometry, TaskPool* pool) {
  const Planes mean = Combine(guide.a, guide.b, halves.share_a.view(), pool);
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), patches, pool);
  JointGuides guides = {MakeJointGuide(std::move(guide.a), basis, sigma_q, geometry),
                        MakeJointGuide(std::move(guide.b), basis, sigma_q, geometry)};
  guides.a.of = guide.of_a;
  guides.b.of = guide.of_b;
  return guides;
}

Planes JointFeatures(const JointGuide& guide, TaskPool* pool) {
  Planes features = ProjectPatches(guide.color, guide.basis, pool);
  for (const Plane& plane : guide.geometry) features.push_back(plane.Clone());
  return features;
}

std::vector<ManifoldCall> CallsOf(absl::Span<const GuidedFiltering> filterings, const ManifoldParams& params,
                                  float reach) {
  std::vector<ManifoldCall> calls;
  for (const GuidedFiltering& filtering : filterings) {
    calls.push_back({ViewsOf(filtering.signals),
                     filtering.base != nullptr ? ViewsOf(*filtering.base) : PlaneViews{},
                     ProjectionOf(filtering), ViewsOf(filtering.guide.geometry), filtering.mask, params,
                     reach, filtering.points});
  }
  return calls;
}

std::vector<ManifoldResult> FilterGuided(absl::Span<const GuidedFiltering> filterings,
                                         const ManifoldParams& params, float reach, TaskPool* pool) {
  if (auto results = FilterOnDevice(filterings, params, reach, pool)) return *std::move(results);
  std::vector<ManifoldResult> results;
  const JointGuide* guide = nullptr;
  float scale = 1;
  Planes features;
  for (const GuidedFiltering& filtering : filterings) {
    if (&filtering.guide != guide || scale != 1) {
      features.clear();  // two guides' would need the most memory of all
      guide = &filtering.guide;
      features = JointFeatures(*guide, pool);
    }
    scale = filtering.scale;
    if (scale != 1) ScalePatches(scale, guide->geometry.size(), pool, &features);
    Planes rest;
    if (filtering.base != nullptr) rest = Difference(filtering.signals, *filtering.base, pool);
    results.push_back(ManifoldFilterAtPoints(rest.empty() ? filtering.signals : rest, features,
                                             filtering.mask, params, reach, filtering.points, pool));
  }
  return results;
}

}  // namespace lumifold::filter
