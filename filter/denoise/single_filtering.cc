#include "filter/denoise/single_filtering.h"

#include "filter/layers/features.h"

namespace lumifold::filter {

Planes FilterSingle(const Halves& halves, const Planes& mean, const Planes& geometry,
                    const LayerSettings& settings, TaskPool* pool) {
  const SingleFilteringParams& params = settings.single;
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), settings.patches, pool);
  const Planes features =
      JointFeatures(mean, basis, params.range_factor * PositiveNoise(halves, pool), geometry, pool);
  return ManifoldFilter(mean, features, halves.weight.view(), params.manifolds, pool);
}

}  // namespace lumifold::filter
