#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// "irradiance-cache": indirect light on diffuse first surfaces is gathered at few points and interpolated
/// between them. The cache is filled from grids of pixels, coarse to fine. The candidates of a batch are
/// gathered in parallel against the current cache and then inserted one by one, so that the result is
/// identical for any pool.
/// Bias:    lobes are treated as Lambertian; detail finer than the radius of a record is lost.
/// Source:  Ward, Rubinstein & Clear 1988; Ward & Heckbert 1992; Krivanek et al. 2006.
RenderMethod IrradianceCachingMethod();

}  // namespace lumifold::charts
