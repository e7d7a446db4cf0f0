#pragma once

#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// "random-parameters": random parameter filtering. It runs four passes over boxes of 55, 35, 17 and 7
/// pixels. In each pass a sample becomes the weighted mean of other samples drawn from around its pixel. The
/// weights compare colours and features; how much each counts follows from its mutual information with the
/// position and with the random numbers of the sample: light and lobe choice, point on the light, direction,
/// lens. Features are position, normal and albedo of the first surface; those of the second are not recorded.
/// The energy that clamping outliers removes or adds is restored in every pass. The bias that few samples
/// give mutual information is subtracted: with it, as published, every variable appears to depend on the
/// random numbers.
/// Source:  Sen & Darabi 2012.
SampleMethod RandomParametersMethod();

}  // namespace lumifold::charts
