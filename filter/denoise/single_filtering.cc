#include "filter/denoise/single_filtering.h"

#include <utility>

#include "filter/layers/guide.h"

namespace lumifold::filter {

ManifoldResult FilterSingle(const Halves& halves, const Planes& mean, const Planes& geometry,
                            const LayerSettings& settings, const SlicePoints* points, TaskPool* pool) {
  const SingleFilteringParams& params = settings.single;
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), settings.patches, pool);
  const JointGuide guide =
      MakeJointGuide(Clone(mean), basis, params.range_factor * PositiveNoise(halves, pool), geometry);
  const GuidedFiltering filtering = {mean, nullptr, guide, 1, halves.weight.view(), points};
  return std::move(FilterGuided({&filtering, 1}, params.manifolds, params.manifolds.sigma_s, pool).front());
}

}  // namespace lumifold::filter
