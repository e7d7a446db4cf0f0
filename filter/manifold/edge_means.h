#pragma once

#include "filter/image/layered_image.h"
#include "filter/manifold/bands.h"

namespace lumifold::filter {

/// What the sub-samples of edge pixels know of T and E better than the pixel's own samples: the change of
/// (D + I) T + E when T and E are taken as means of both, each trusted by the square of its count, for both
/// are spread evenly over the pixel. It takes out the noise of where few samples fell, is unbiased, and
/// vanishes as samples grow. `direct`, `indirect`: D and I as filtered, W x H, 3 planes. `edges`: as
/// FilterFilm() has them; may be null. Result: W x H, 3 planes; 0 off the edges and where it is not finite.
Planes EdgeMeansChange(const LayeredImage& film, const LayeredImage* edges, const Planes& direct,
                       const Planes& indirect);

}  // namespace lumifold::filter
