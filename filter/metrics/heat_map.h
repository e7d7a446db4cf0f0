#pragma once

#include "filter/image/planes.h"

namespace lumifold::metrics {

/// Where a picture errs: the root of the mean over channels of the squared difference, in 8-bit sRGB steps;
/// the mean of its squares is Mse255. Shapes: W x H, 3 planes each, one size. Threads: safe concurrently.
Plane StepErrors(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// The value that a heat map's brightest colour should stand for: the least of 1, 2 or 5 times a power of ten
/// that all but a thousandth of the values stay below; 1 where all are 0. Values: at least one, none
/// negative.
float HeatScale(ConstFloatView values);

/// Paints values from 0 (black) over violet, red and orange to `top` and above (pale yellow): lightness rises
/// all the way, so that it reads alike for all eyes and in grey. Result: W x H, linear R G B.
Picture HeatMap(ConstFloatView values, float top);

}  // namespace lumifold::metrics
