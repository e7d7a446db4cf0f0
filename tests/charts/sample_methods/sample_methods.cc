#include "tests/charts/sample_methods.h"

#include "tests/charts/sample_methods/methods.h"

namespace lumifold::charts {

const std::vector<SampleMethod>& SampleMethods() {
  static const std::vector<SampleMethod> methods = {EpanechnikovMethod(), GuidedRaysMethod(),
                                                    ProbabilisticMethod(), RandomParametersMethod()};
  return methods;
}

}  // namespace lumifold::charts
