#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

// Local regression of first order. A weighted mean of light that has a gradient is biased where the pixels do
// not lie evenly around the centre: at edges, in corners and at the picture's border. A plane fitted to the
// light with the same weights is not. The filter is linear in its signals, so the moments that the fit needs
// are splatted, blurred and sliced like signals.

/// Signals that are splatted for a fit: f (3), x, y.
inline constexpr size_t kPlaneSignals = 5;
/// Moments that the fit takes: these; x f, y f (6); x^2, x y, y^2.
inline constexpr size_t kMoments = 14;

/// x and y of the pixels, relative to the picture's centre in units of `unit_px` pixels, > 0.
Planes Positions(int width, int height, float unit_px);

/// Adds the products to a manifold's splat of light (3), of Positions() and of weights. A cell's light counts
/// as if it were at the mean position of its pixels: for planar light that is exact. Result: kMoments planes
/// and the weight's.
void AddMoments(Planes* splat);

/// The fitted plane's value at each site. `means`: the moments, blurred, sliced and divided by the weight;
/// `x`, `y`: the sites' Positions(); `ridge` is added to the variances of positions. Result: 3 planes; the
/// light of `means` where all other moments are 0.
/// Threads: identical for any pool.
Planes FitLight(const Planes& means, const Plane& x, const Plane& y, float ridge, TaskPool* pool);

}  // namespace lumifold::filter
