#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

// A mean over pixels of light that rises to one side is wrong where they do not lie evenly about the pixel:
// at edges, in corners and at the picture's border. A plane through the light, fitted with the same weights,
// is not. The filter is linear in its signals, so that the sums it needs can be blurred as they are.

/// What is splatted for a fit: f (3), x, y.
inline constexpr size_t kPlaneSignals = 5;
/// The means that it takes: these; x f, y f (6); x^2, x y, y^2.
inline constexpr size_t kMoments = 14;

/// Light (3 planes), and where pixels are, counted from the picture's middle in units of `unit` pixels, > 0.
/// kPlaneSignals planes.
Planes WithPosition(const Planes& light, float unit, TaskPool* pool);

/// Adds moments to a manifold's splat of WithPosition() and of weights. All that a cell holds is taken to be
/// where its pixels are in the mean: on a plane its light is the plane's there, so that the fit stays true of
/// planes. Result: kMoments planes and the weight's.
void AddMoments(Planes* splat);

/// What the plane through the light says of each pixel. `means`: sums of AddMoments(), blurred and
/// read back, over the weight's. 3 planes. Where the filter found nothing, the pixel's own light.
/// Threads: identical for any pool.
Planes FitLight(const Planes& means, float unit, TaskPool* pool);

/// The same at points, by where their pixels' middles are in a picture of `width` x `height`. 3 channels.
SlicedPoints FitLightAtPoints(const SlicePoints& points, const SlicedPoints& means, float unit, int width,
                              int height);

}  // namespace lumifold::filter
