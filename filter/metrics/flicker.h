#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// Change from one picture to the next, in 8-bit sRGB steps over pixels and channels.
struct Flicker {
  double mean = 0;
  double percentile99 = 0;
};

/// How much two pictures of one thing differ: of two seeds, or of two frames of an animation.
/// Shapes: W x H, 3 planes each, one size, at least one pixel. Threads: safe concurrently.
Flicker MeasureFlicker(const ConstColorView& picture, const ConstColorView& next, float exposure = 1.0f);

}  // namespace lumifold::metrics
