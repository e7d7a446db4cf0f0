#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "nfor": nonlinearly weighted first-order regression of the film's noisy picture on normals, albedo and
/// distance. Half A is fitted with the weights of half B and the reverse, at two bandwidths. The bandwidth
/// with the smaller error, estimated across the halves, is selected per pixel and channel. A second pass
/// filters the result. Pixels in mirrors and behind glass use the features of the surface seen there. A film
/// holds no halves of the features, so they are not filtered first: noise in the albedo, as from a wide
/// aperture, enters the fit. The sample variance is estimated from the halves over 7x7 pixels.
/// Source:  Bitterli et al. 2016.
Baseline NforBaseline();

}  // namespace lumifold::filter
