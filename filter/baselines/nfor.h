#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "nfor": nonlinearly weighted first-order regression of the film's noisy picture on normals, albedo and
/// distance. Half A is fitted with the weights of half B and the reverse, at two bandwidths. The bandwidth
/// with the smaller error, estimated across the halves, is selected per pixel and channel. A second pass
/// filters the result. Pixels in mirrors and behind glass use the features of the surface seen there.
/// Features are filtered first where the film tells their noise: on edges (PrefilteredFeatures()). A film
/// holds no variance of single samples: HalfVariance() takes its place.
/// Source:  Bitterli et al. 2016.
Baseline NforBaseline();

}  // namespace lumifold::filter
