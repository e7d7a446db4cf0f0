#pragma once

#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// "epanechnikov": every sample is spread over the pixels around its own by the kernel 1 - t^2 with radius
/// scale sqrt(Y / (n f)): Y is the sample's luminance, n the samples per pixel, f the picture's luminance at
/// that place. Bright outliers are spread furthest; all radii shrink as samples grow. The kernel preserves
/// energy: weights that would fall outside the picture are mirrored back into it.
/// Source:  Suykens & Willems 2000. A reconstruction: the scale of the radius and the estimate of f (means
///          over windows) are ours.
SampleMethod EpanechnikovMethod();

}  // namespace lumifold::charts
