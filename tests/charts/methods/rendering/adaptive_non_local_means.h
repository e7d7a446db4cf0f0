#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// Adaptive sampling by dual-buffer non-local means: two halves of the samples are filtered, each with the
/// weights of the other's patches; what the results differ by is the error that is left, and says where the
/// next samples go. The picture is the mean of both. Not as published: a tenth of the samples goes to all
/// pixels alike, and what noise stays after the filter is not filtered again. Source: Rousselle, Knaus &
/// Zwicker 2012, "Adaptive Rendering with Non-Local Means Filtering".
RenderMethod AdaptiveNonLocalMeansMethod();

}  // namespace lumifold::charts
