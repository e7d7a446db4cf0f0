#pragma once

#include "filter/image/parallel.h"
#include "filter/manifold/bands.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

// A mean over pixels of light that rises to one side is wrong where they do not lie evenly about the pixel:
// at edges, in corners and at the picture's border. A plane through the light, fitted with the same weights,
// is not. The filter is linear in its signals, so that the sums it needs are signals, too.

/// Light and its moments over the position in the picture: f (3 planes); x, y; x f, y f (6); x^2, x y, y^2,
/// all counted from the picture's middle in units of `unit` pixels, > 0. 14 planes.
Planes WithMoments(const Planes& light, float unit, TaskPool* pool);

/// What the plane through the light says of each pixel. `means`: what ManifoldFilter() makes of WithMoments()
/// of the same unit. 3 planes. Where the filter found nothing, the pixel's own light. Threads: identical for
/// any pool.
Planes FitLight(const Planes& means, float unit, TaskPool* pool);

/// The same at points, by where their pixels' middles are in a picture of `width` x `height`. `means`: what
/// was sliced of WithMoments(). 3 channels.
SlicedPoints FitLightAtPoints(const SlicePoints& points, const SlicedPoints& means, float unit, int width,
                              int height);

}  // namespace lumifold::filter
