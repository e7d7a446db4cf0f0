#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// Irradiance caching: indirect light on diffuse first surfaces is gathered at few places and interpolated
/// between them. The cache is filled from lattices of pixels, coarse to fine: candidates gather side by side
/// against the cache as it stands, then enter it one by one, so that it is the same for any pool.
/// Bias: lobes are taken for Lambertian, and detail finer than a record reaches is lost.
/// Source: Ward, Rubinstein & Clear 1988; Ward & Heckbert 1992; Krivanek et al. 2006.
RenderMethod IrradianceCachingMethod();

}  // namespace lumifold::charts
