#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// How much tiles show: the mean difference from the untiled picture over pixels on either side of a tile's
/// boundary, over that of all others; as displayed. 1 means that boundaries stand out by nothing; equal
/// pictures give 0; infinite where boundaries alone differ.
/// Shapes:  W x H, 3 planes each, one size. tile: its side in pixels, over 2.   Threads: safe concurrently.
double SeamIndex(const ConstColorView& tiled, const ConstColorView& untiled, int tile, float exposure = 1.0f);

}  // namespace lumifold::metrics
