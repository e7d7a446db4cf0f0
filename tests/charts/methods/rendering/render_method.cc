#include "tests/charts/methods/rendering/render_method.h"

#include <algorithm>

#include "tests/charts/methods/rendering/adaptive_non_local_means.h"
#include "tests/charts/methods/rendering/greedy_error_minimization.h"
#include "tests/charts/methods/rendering/irradiance_caching.h"
#include "tests/charts/methods/rendering/irradiance_filtering.h"
#include "tests/charts/methods/rendering/multidimensional_sampling.h"

namespace lumifold::charts {

const std::vector<RenderMethod>& RenderMethods() {
  static const std::vector<RenderMethod> methods = {
      IrradianceCachingMethod(), IrradianceFilteringMethod(), GreedyErrorMinimizationMethod(),
      AdaptiveNonLocalMeansMethod(), MultidimensionalSamplingMethod()};
  return methods;
}

const RenderMethod* FindRenderMethod(std::string_view name) {
  const std::vector<RenderMethod>& all = RenderMethods();
  const auto found = std::find_if(all.begin(), all.end(),
                                  [&](const RenderMethod& method) { return method.info.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace lumifold::charts
