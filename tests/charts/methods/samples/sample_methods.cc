#include "tests/charts/methods/samples/sample_method.h"

#include "tests/charts/methods/samples/methods.h"

namespace lumifold::charts {

const std::vector<SampleMethod>& SampleMethods() {
  static const std::vector<SampleMethod> methods = {EpanechnikovMethod(), GuidedRaysMethod(),
                                                    ProbabilisticMethod(), RandomParametersMethod()};
  return methods;
}

}  // namespace lumifold::charts
