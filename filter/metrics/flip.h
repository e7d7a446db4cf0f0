#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// FLIP: the perceived difference of two pictures shown alternately, per pixel, from 0 (equal) to 1, on a
/// display of 67 pixels per degree (3840 pixels on 0.7 m, seen from 0.7 m).
/// Shapes:  picture, reference: W x H, 3 planes, one size, at least one pixel. Result: W x H.
/// Units:   linear radiance, displayed as exposure * light, clamped to [0, 1]; NaN counts as black.
/// Edges:   clamped.
/// Threads: safe concurrently.
/// Source:  Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom & Fairchild 2020.
Plane FlipMap(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// The mean of FlipMap.
double Flip(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// FLIP for high dynamic range: per pixel the maximum of FLIP over a series of exposures, at most one stop
/// apart. The first exposure displays the reference's brightest pixel at 0.85 by the ACES curve, the last one
/// its median (of pixels that are not black). Negative light and NaN count as black. Shapes as FlipMap.
/// Source:  Andersson, Nilsson, Shirley & Akenine-Moller 2021; Narkowicz 2016 for the curve.
Plane HdrFlipMap(const ConstColorView& picture, const ConstColorView& reference);

/// The mean of HdrFlipMap.
double HdrFlip(const ConstColorView& picture, const ConstColorView& reference);

}  // namespace lumifold::metrics
