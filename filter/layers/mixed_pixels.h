#pragma once

#include "filter/image/plane.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// 1 where what a pixel shows differs from its neighbourhood: pixels of the edge set, diffuse ones next to them, metals,
/// and pixels that show a level; 0 elsewhere. W x H.
Plane MixedPixelsOf(const Frame& frame);

}  // namespace lumifold::filter
