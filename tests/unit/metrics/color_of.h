#pragma once

#include "filter/image/layered_image.h"

namespace lumifold::metrics {

/// The colour of a picture that has no other layers.
inline ConstColorView ColorOf(const LayeredImage& image) { return image.GetColor(""); }

}  // namespace lumifold::metrics
