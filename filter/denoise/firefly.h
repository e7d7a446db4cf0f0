#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// Clamps fireflies in both halves. A half's pixel is scaled down to twice the 75th percentile of the
/// luminance of its 5x5 neighbourhood in X if it is above that bound and noise explains the excess: three
/// sigma reach from the pixel down to the bound. Sigma is the difference of the halves; where the pixel is
/// over twice as bright as each neighbour, it is at least the relative noise of the 25x25 window, since both
/// halves may have hit a firefly. Layers that are differences of light stay: they are mostly near 0, so that
/// all detail would be an outlier.
/// Shapes:  result: what was removed, as a part of X, 3 planes; empty where nothing was.
/// Threads: identical for any pool.
/// Source:  the outlier test of Cycles' feature prefilter.
Planes SuppressFireflies(Halves* halves, TaskPool* pool);

/// Radius in pixels of what SuppressFireflies() reads for a pixel.
int FireflyWindow();

/// Sigma of the blur that spreads the removed energy.
inline constexpr float kSpreadReachPx = 16;

/// The energy that SuppressFireflies() removed, where it is to be added again. It is spread over pixels of similar
/// light on the same surface nearby, as far as several outliers say that it belongs there: a sum of n equal terms
/// stands by 1 - 1/n on average, so that one outlier alone returns nothing, however small its surface is. What is left is added to all of the layer in
/// proportion to its light, by the same rule.
/// Shapes:  removed, light: 3 planes, `light` without noise; geometry: features; result: 3 planes; all of the
///          layer's size. `knee`: as in MakeGuide().
/// Threads: identical for any pool.
Planes ReturnRemoved(const Planes& removed, const Planes& light, const Halves& halves, const Planes& geometry,
                     float knee, TaskPool* pool);

}  // namespace lumifold::filter
