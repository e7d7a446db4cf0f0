#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold::filter {

/// Takes the noise of the coverage out of pixels that show several surfaces, or one in a part of them: chance
/// decides which of few samples fell on which. The light of each surface that the sub-samples show is fitted,
/// by least squares, to `picture` over the 5x5 pixels about it that show no other ones, and the pixel is
/// drawn towards the mean of light times T, plus E, over its sub-samples: as far as it agrees with C on such
/// pixels near by (TrustIn). A slice of a surface that all sub-samples of a pixel miss and its own
/// samples hit is lit as the pixels beside it. Surfaces are told apart by object, normal and distance; films
/// without id.Y stay as they are. So do pixels with a mirror, glass or metal in a sub-sample, those where
/// more than `max_glossy_albedo` of the light is reflected by glossy lobes, and those of one half alone.
/// `edges` may be null. Source: the sub-samples of Gruzdev et al. 2015; the fit is our own. Threads:
/// identical for any pool.
void RelightEdges(const LayeredImage& film, const LayeredImage* edges, float max_glossy_albedo,
                  TaskPool* pool, std::array<Plane, 3>* picture);

}  // namespace lumifold::filter
