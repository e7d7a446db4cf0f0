#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

// Local regression of first order. A weighted mean of light that has a gradient is biased where the pixels do
// not lie evenly around the centre: at edges, in corners and at the picture's border. A plane fitted to the
// light with the same weights is not. The filter is linear in its signals, so the moments that the fit needs
// are splatted, blurred and sliced like signals.

/// Moments that the fit of `signals` signals f takes: f, x, y; x f, y f; x^2, x y, y^2.
constexpr size_t MomentCount(size_t signals) { return 3 * signals + 5; }

/// The light and the pixels' positions x and y, relative to the picture's centre in units of `unit_px`
/// pixels, > 0: two planes more.
Planes WithPosition(const Planes& light, float unit_px, TaskPool* pool);

/// Adds the products to a manifold's splat of WithPosition() and of weights. A cell's light counts as if it
/// were at the mean position of its pixels: for planar light that is exact. Result: the moments' planes and
/// the weight's.
void AddMoments(Planes* splat);

/// The fitted plane's value at each pixel. `means`: the moments, blurred, sliced and divided by the weight;
/// `ridge` is added to the variances of positions. Result: as many planes as there are signals; the pixel's
/// own light where the filter found nothing.
/// Threads: identical for any pool.
Planes FitLight(const Planes& means, float unit_px, float ridge, TaskPool* pool);

/// The same at points, which count as if they were at the centres of their pixels, in a picture of `width` x
/// `height`.
SlicedPoints FitLightAtPoints(const SlicePoints& points, const SlicedPoints& means, float unit_px,
                              float ridge, int width, int height);

}  // namespace lumifold::filter
