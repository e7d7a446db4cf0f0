#include "filter/layers/guide.h"

#include <algorithm>
#include <utility>

#include "filter/layers/features.h"

namespace lumifold::filter {

Guide MakeGuide(const Halves& halves, const Planes& a, const Planes& b, float knee, TaskPool* pool) {
  return {Stabilise(a, knee * halves.level, halves.level, pool),
          Stabilise(b, knee * halves.level, halves.level, pool)};
}

float NoiseOfHalf(const Halves& halves, const Guide& guide, TaskPool* pool) {
  constexpr float kHalfOverMean = 1.41421356f;
  constexpr float kLeast = 1e-4f;
  return std::max(kHalfOverMean * NoiseLevel(halves, guide.a, guide.b, pool), kLeast);
}

FeaturePair MakeFeatures(Guide&& from, const Halves& halves, const PatchParams& patches, float sigma_q,
                         const Planes& geometry, TaskPool* pool) {
  const Guide guide = std::move(from);
  const Planes mean = Combine(guide.a, guide.b, halves.share_a.view(), pool);
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), patches, pool);
  return {JointFeatures(guide.a, basis, sigma_q, geometry, pool),
          JointFeatures(guide.b, basis, sigma_q, geometry, pool)};
}

}  // namespace lumifold::filter
