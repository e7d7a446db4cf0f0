#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// Removes the noise of the coverage from pixels that show several surfaces, or one surface in a part of the
/// pixel: few samples fall on each surface at random. The light of each surface that the sub-samples hit is
/// fitted to `picture` by least squares over the pixels of a 5x5 window that show no other surfaces. The
/// pixel is then drawn towards the mean of light * T + E over its sub-samples, as far as TrustIn() follows
/// it. A surface that all sub-samples of a pixel miss but its own samples hit is lit like the pixels beside
/// it. Surfaces differ by object id, normal and distance.
///
/// Left as they are: films without object ids, pixels with a mirror, glass or metal in a sub-sample, pixels
/// where the albedo of the glossy lobes is above `max_glossy_albedo`, and pixels with one half alone.
/// Threads: identical for any pool.
/// Source:  the sub-samples of Gruzdev et al. 2015; the fit is our own.
void RelightEdges(const Frame& frame, float max_glossy_albedo, TaskPool* pool, Picture* picture);

/// Radius in pixels of what a pixel of the result depends on.
int RelightingWindow();

}  // namespace lumifold::filter
