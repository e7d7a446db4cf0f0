#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// Draws F back towards C where noise cannot explain their difference: F + max(0, 1 - c v / r^2) (C - F) with
/// c = 4. v is C's variance from its halves: the larger of its means over a small and over a wide window. r^2
/// is the mean of (C - F)^2 over the small window. At few samples one pixel alone does not draw its window
/// back. So F converges to C as samples grow. Does nothing where the film has no second half.
/// Threads: identical for any pool.
void ShrinkResidual(const Frame& frame, TaskPool* pool, Picture* picture);

/// Radius in pixels of what a pixel of the result depends on.
int ShrinkWindow();

}  // namespace lumifold::filter
