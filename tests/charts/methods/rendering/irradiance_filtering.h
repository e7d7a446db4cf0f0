#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// Irradiance filtering: every pixel gathers the indirect irradiance at its centre with few paths, and takes
/// the mean of its neighbours' in space, weighted down with distance and turn of the normal, over a share of
/// the harmonic mean distance of what is seen from there: what is far away lights a place evenly. A
/// reconstruction from the idea: no code of its authors was to be had.
/// Source: Kontkanen, Rasanen & Keller 2004, "Irradiance Filtering for Monte Carlo Ray Tracing".
RenderMethod IrradianceFilteringMethod();

}  // namespace lumifold::charts
