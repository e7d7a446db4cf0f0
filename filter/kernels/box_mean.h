#pragma once

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The weighted means of some planes over the (2 radius + 1)^2 window around each pixel, cut at the picture's
/// edge; 0 where nothing weighs. Weights are >= 0, all planes of one size. Threads: identical for any pool.
/// Cost grows with the logarithm of radius.
Planes BoxMeans(const Planes& values, ConstFloatView weight, int radius, TaskPool* pool);

}  // namespace lumifold::filter
