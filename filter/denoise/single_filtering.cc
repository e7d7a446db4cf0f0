#include "filter/denoise/single_filtering.h"

#include "filter/layers/features.h"

namespace lumifold::filter {

ManifoldResult FilterSingle(const Halves& halves, const Planes& mean, const Planes& geometry,
                            const LayerSettings& settings, const SlicePoints* points, TaskPool* pool) {
  const SingleFilteringParams& params = settings.single;
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), settings.patches, pool);
  const Planes features =
      JointFeatures(mean, basis, params.range_factor * PositiveNoise(halves, pool), geometry, pool);
  return ManifoldFilterAtPoints(mean, features, halves.weight.view(), params.manifolds,
                                params.manifolds.sigma_s, points, pool);
}

}  // namespace lumifold::filter
