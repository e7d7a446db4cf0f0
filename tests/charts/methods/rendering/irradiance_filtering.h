#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// "irradiance-filtering": every pixel gathers the indirect irradiance at its centre with few paths. The
/// result is the weighted mean over neighbours in space; weights fall with distance and with the angle
/// between normals. The radius is a fraction of the harmonic mean distance of the visible surfaces, because
/// distant surfaces light an area evenly. A reconstruction of the idea: the authors' code is not available.
/// Source:  Kontkanen, Rasanen & Keller 2004, "Irradiance Filtering for Monte Carlo Ray Tracing".
RenderMethod IrradianceFilteringMethod();

}  // namespace lumifold::charts
