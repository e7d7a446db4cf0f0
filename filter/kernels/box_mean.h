#pragma once

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Weighted means of planes over the (2 radius + 1)^2 window around each pixel; 0 where the weights sum to 0.
/// Shapes:  values, weight, result: W x H. Weights are >= 0.
/// Edges:   the window is cut at the picture's edge.
/// Cost:    grows with the radius.
/// Threads: identical for any pool.
Planes BoxMeans(const Planes& values, ConstFloatView weight, int radius, TaskPool* pool);

}  // namespace lumifold::filter
