#pragma once

#include <array>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/layers/layer_fragments.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

struct FireflyParams {
  int radius = 2;          // px: the neighbourhood that sets the bound
  float quantile = 0.75f;  // of the neighbourhood's luminance
  float excess = 2;  // a pixel may be above that quantile by this factor, or by as many deviations of a half
  float sigmas = 3;  // deviations by which noise explains what both halves show
  // Of what spreads the removed energy, where geometry and light vary little.
  float spread_light = 1.7f;  // range of a channel, stabilised
  int spread_height = 3;      // of the manifold tree
};

/// Clamps fireflies in both halves. A half's pixel is scaled down to a bound if it is above it and noise
/// explains why: the other half shows less than half of the excess over the bound. The bound is a quantile of
/// the luminance of its neighbourhood in X, or the mean of its neighbours where that quantile is 0, times
/// max(excess, 1 + excess noise), with the relative noise of a half in a window around: where samples are
/// few, noise alone exceeds a fixed factor. Where both halves show the excess, as both may have hit a
/// firefly, that noise must explain it, and the pixel must be brighter than each neighbour by the same
/// factor. Layers that are differences of light stay: they are mostly near 0, so that all detail would be an
/// outlier.
/// Shapes:  `noise_radius`: of that window, in pixels; result: what each half lost, 3 planes; empty where
///          neither did.
/// Threads: identical for any pool.
/// Source:  the outlier test of Cycles' feature prefilter.
std::array<Planes, 2> SuppressFireflies(const FireflyParams& params, int noise_radius, Halves* halves,
                                        TaskPool* pool);

/// A sample that is an outlier of a layer may have met less of the factor than the mean of its pixel, such as
/// at an edge in a mirror. Then C has less of it than the product of means, and the remainder of its half is
/// negative. What is missing in C was never there: *removed loses as much, at most all, so that it does not
/// return.
/// Shapes:  removed[h]: 3 planes of the product's box, what SuppressFireflies() took from `halves`. Result:
///          what is missing of each half's product, in the film's unit; empty: nothing.
/// Threads: identical for any pool.
std::array<Planes, 2> TakeMissing(const Product& product, const LayerFragments& fragments,
                                  const Halves& halves, TaskPool* pool, std::array<Planes, 2>* removed);

/// The energy that SuppressFireflies() removed, where it is to be added again to each half: what it lost
/// itself, so that neither holds samples of the other. It is spread over pixels of similar light on the same
/// surface nearby, as far as several outliers of the halves together say that it belongs there: a sum of n
/// equal terms stands by 1 - 1/n on average, so that one outlier alone returns nothing, however small its
/// surface is. What is left is added to all of the layer in proportion to its light, by the same rule.
/// Shapes:  removed[h], light: 3 planes, `light` without noise; geometry: features; result[h]: 3 planes; all
///          of the layer's size. `knee`: as in MakeGuide(); `reach_px`: of the spread.
/// Threads: identical for any pool.
std::array<Planes, 2> ReturnRemoved(const std::array<Planes, 2>& removed, const Planes& light,
                                    const Halves& halves, const Planes& geometry, float knee, float reach_px,
                                    const FireflyParams& params, TaskPool* pool);

}  // namespace lumifold::filter
