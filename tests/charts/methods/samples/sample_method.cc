#include "tests/charts/methods/samples/sample_method.h"

#include "tests/charts/methods/samples/epanechnikov.h"
#include "tests/charts/methods/samples/guided_rays.h"
#include "tests/charts/methods/samples/probabilistic.h"
#include "tests/charts/methods/samples/random_parameters.h"
#include "tests/charts/methods/samples/statistical.h"

namespace lumifold::charts {

const std::vector<SampleMethod>& SampleMethods() {
  static const std::vector<SampleMethod> methods = {EpanechnikovMethod(), GuidedRaysMethod(),
                                                    ProbabilisticMethod(), RandomParametersMethod(),
                                                    StatisticalMethod()};
  return methods;
}

}  // namespace lumifold::charts
