#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

/// C plus what the filter changed: C + sum of (filtered - mean) * factor. What the filter left alone passes
/// through to the last bit. Result: W x H, R G B; unusable values count as 0.
/// Threads: identical for any pool.
Picture Recombine(const Frame& frame, const std::vector<FilteredProduct>& filtered, TaskPool* pool);

/// picture += after - before inside `box`.
/// Shapes: after: 3 planes of the box's size; before: 3 planes, W x H. Unusable values count as 0.
void AddChange(const ConstColorView& before, const Planes& after, const Rect& box, TaskPool* pool,
               Picture* picture);

}  // namespace lumifold::filter
