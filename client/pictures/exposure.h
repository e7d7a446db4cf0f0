#pragma once

#include "filter/image/plane.h"

namespace lumifold::pictures {

/// The exposure of a picture that nobody has set: the mean of the logarithm of its luminance becomes middle
/// grey, unless that would make more than a tenth of the pixels brighter than `white`, the brightest value
/// that a view shows. 1 for a black picture.
/// Source of the first rule: Reinhard et al. 2002, "Photographic Tone Reproduction for Digital Images".
float AutomaticExposure(const ConstColorView& linear, float white);

/// The brightest value of a view that AutomaticExposure should keep.
float WhiteOf(const char* view);

}  // namespace lumifold::pictures
