#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// Visibility of tile boundaries: the mean difference from the untiled picture of pixels on either side of a
/// boundary, divided by that of all other pixels, in displayed values. 1 means that boundaries do not stand
/// out; equal pictures give 0; infinite if only boundaries differ.
/// Shapes:  W x H, 3 planes each, one size. tile: its side in pixels, over 2.
/// Threads: safe concurrently.
double SeamIndex(const ConstColorView& tiled, const ConstColorView& untiled, int tile, float exposure = 1.0f);

}  // namespace lumifold::metrics
