#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Sum of |value| over the three channels of row y; unusable values and pixels of weight 0 count as 0.
/// `weight` may be empty: all pixels count.
double RowMagnitude(const ConstColorView& color, ConstFloatView weight, int y);

/// Mean of |value| over all pixels and channels; unusable values count as 0.
/// Threads: identical for any pool.
float MeanMagnitude(const ConstColorView& color, TaskPool* pool);

}  // namespace lumifold::filter
