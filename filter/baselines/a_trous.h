#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "a-trous": five iterations of a 5x5 kernel with taps 1, 2, 4, 8 and 16 pixels apart, on each layer of
/// light. Each tap is weighted by the similarity of light, normal and depth. Depth replaces the world
/// position, which a film does not hold. Taps outside the picture are skipped.
/// Source:  Dammertz, Sewtz, Hanika & Lensch 2010.
Baseline ATrousBaseline();

/// "a-trous-variance": the same iterations, with luminance weighted relative to its noise. The variance is
/// estimated from the halves over 7x7 pixels and filtered along with the light. There is no temporal
/// accumulation, since there is a single frame.
/// Source:  Schied et al. 2017, spatial part.
Baseline ATrousVarianceBaseline();

}  // namespace lumifold::filter
