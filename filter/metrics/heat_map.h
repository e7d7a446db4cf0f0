#pragma once

#include "filter/image/planes.h"

namespace lumifold::metrics {

/// The error of each pixel: root mean square over channels of the difference, in 8-bit sRGB steps. The mean
/// of its squares is Mse255.
/// Shapes: W x H, 3 planes each, one size.
/// Threads: safe concurrently.
Plane StepErrors(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// The value for the brightest colour of a heat map: the smallest of 1, 2 or 5 times a power of ten that 99.9
/// % of the values do not exceed; 1 if all are 0. Values: at least one, none negative.
float HeatScale(ConstFloatView values);

/// Maps values to colours from 0 (black) over violet, red and orange to `top` and above (pale yellow).
/// Lightness rises monotonically, so that the map is readable for colour-blind readers and in grey. Result: W
/// x H, linear R G B.
Picture HeatMap(ConstFloatView values, float top);

}  // namespace lumifold::metrics
