#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// FLIP: how different two pictures look when one is shown after the other, pixel by pixel, from 0 (alike) to
/// 1; seen on a display of 67 pixels a degree (0.7 m before 3840 pixels on 0.7 m).
/// Shapes:  picture, reference: W x H, 3 planes, one size, at least one pixel. Result: W x H.
/// Units:   linear radiance, shown as exposure * light clamped to [0, 1]; NaN counts as black.
/// Edges:   clamped.   Threads: safe concurrently.
/// Source:  Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom & Fairchild 2020.
Plane FlipMap(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// The mean of FlipMap.
double Flip(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// FLIP of light without a display's limits: the greatest FLIP of each pixel over exposures a stop apart or
/// less, from where the reference's brightest pixel to where its median (of the pixels that are not black) is
/// shown at 0.85 by the ACES curve. Negative light and NaN count as black. Shapes as FlipMap.
/// Source:  Andersson, Nilsson, Shirley & Akenine-Moller 2021; Narkowicz 2016 for the curve.
Plane HdrFlipMap(const ConstColorView& picture, const ConstColorView& reference);

/// The mean of HdrFlipMap.
double HdrFlip(const ConstColorView& picture, const ConstColorView& reference);

}  // namespace lumifold::metrics
