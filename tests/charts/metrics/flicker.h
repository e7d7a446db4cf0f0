#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// Absolute difference of two pictures over pixels and channels, in 8-bit sRGB steps.
struct Flicker {
  double mean = 0;
  double percentile99 = 0;
};

/// Compares two pictures of the same scene: of two seeds, or of two frames of an animation.
/// Shapes: W x H, 3 planes each, one size, at least one pixel.
/// Threads: safe concurrently.
Flicker MeasureFlicker(const ConstColorView& picture, const ConstColorView& next, float exposure = 1.0f);

}  // namespace lumifold::metrics
