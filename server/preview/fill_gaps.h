#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/plane.h"

namespace lumifold::server {

/// Gives pixels of `colour` without `samples` what those around them have, the more blurred the farther these
/// are: a picture of which some tiles are rendered is a coarse picture of the whole. No effect where no pixel
/// or every one has samples.
/// Source: Gortler et al. 1996, "The Lumigraph", pull and push, with weights 0 and 1.
void FillGaps(const Plane& samples, ColorView colour);

}  // namespace lumifold::server
