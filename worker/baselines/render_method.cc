#include "worker/baselines/render_method.h"

#include <algorithm>

#include "worker/baselines/adaptive_non_local_means.h"
#include "worker/baselines/greedy_error_minimization.h"
#include "worker/baselines/irradiance_caching.h"
#include "worker/baselines/irradiance_filtering.h"
#include "worker/baselines/multidimensional_sampling.h"

namespace lumifold::render {

const std::vector<RenderMethod>& RenderMethods() {
  static const std::vector<RenderMethod> methods = {
      IrradianceCachingMethod(), IrradianceFilteringMethod(), GreedyErrorMinimizationMethod(),
      AdaptiveNonLocalMeansMethod(), MultidimensionalSamplingMethod()};
  return methods;
}

const RenderMethod* FindRenderMethod(std::string_view name) {
  const std::vector<RenderMethod>& all = RenderMethods();
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const RenderMethod& method) { return method.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace lumifold::render
