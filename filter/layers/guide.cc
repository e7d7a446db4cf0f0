#include "filter/layers/guide.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

PatchProjection ProjectionOf(const GuidedFiltering& filtering) {
  const JointGuide& guide = filtering.guide;
  return {ViewsOf(guide.color), guide.basis.radius, guide.basis.dimensions, guide.basis.kernels,
          filtering.scale};
}

/// nullopt: the processor filters. `signals`: what the base leaves.
std::optional<ManifoldResult> FilterOnDevice(const GuidedFiltering& filtering, const Planes& signals,
                                             const ManifoldParams& params, float reach, TaskPool* pool) {
  FilterDevice* const device = DeviceOf(pool);
  if (device == nullptr || filtering.mask.width() == 0 || filtering.mask.height() == 0) return std::nullopt;
  return device->Filter({ViewsOf(signals), ProjectionOf(filtering), ViewsOf(filtering.guide.geometry),
                         filtering.mask, params, reach, filtering.points});
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
  return {Stabilise(a, knee * level, level, pool), Stabilise(b, knee * level, level, pool)};
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
  return {MakeJointGuide(std::move(guide.a), basis, sigma_q, geometry),
          MakeJointGuide(std::move(guide.b), basis, sigma_q, geometry)};
}

Planes JointFeatures(const JointGuide& guide, TaskPool* pool) {
  Planes features = ProjectPatches(guide.color, guide.basis, pool);
  for (const Plane& plane : guide.geometry) features.push_back(plane.Clone());
  return features;
}

std::vector<ManifoldResult> FilterGuided(absl::Span<const GuidedFiltering> filterings,
                                         const ManifoldParams& params, float reach, TaskPool* pool) {
  std::vector<ManifoldResult> results;
  const JointGuide* guide = nullptr;
  float scale = 1;
  Planes features;
  for (const GuidedFiltering& filtering : filterings) {
    Planes rest;
    if (filtering.base != nullptr) rest = Difference(filtering.signals, *filtering.base, pool);
    const Planes& signals = filtering.base != nullptr ? rest : filtering.signals;
    if (auto result = FilterOnDevice(filtering, signals, params, reach, pool)) {
      results.push_back(*std::move(result));
      continue;
    }
    if (&filtering.guide != guide || scale != 1) {
      features.clear();  // two guides' would need the most memory of all
      guide = &filtering.guide;
      features = JointFeatures(*guide, pool);
    }
    scale = filtering.scale;
    if (scale != 1) ScalePatches(scale, guide->geometry.size(), pool, &features);
    results.push_back(
        ManifoldFilterAtPoints(signals, features, filtering.mask, params, reach, filtering.points, pool));
  }
  return results;
}

}  // namespace lumifold::filter
