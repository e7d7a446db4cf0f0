#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "a-trous": five rounds of a 5x5 kernel whose taps lie 1, 2, 4, 8 and 16 pixels apart, on each layer of
/// light; each tap is weighed by how near its light, normal and depth are. Depth stands for the place in the
/// scene, which a film does not hold. Taps outside the picture do not count.
/// Source:  Dammertz, Sewtz, Hanika & Lensch 2010.
Baseline ATrousBaseline();

/// "a-trous-variance": the same rounds with luminance weighed against its own noise, whose variance is
/// estimated from the halves over 7x7 pixels and filtered along. Without the accumulation over frames, a
/// single frame having none.
/// Source:  Schied et al. 2017, spatial part.
Baseline ATrousVarianceBaseline();

}  // namespace lumifold::filter
