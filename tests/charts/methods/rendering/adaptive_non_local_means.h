#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// "adaptive-nlm": adaptive sampling by dual-buffer non-local means. Two halves of the samples are filtered,
/// each with weights from the patches of the other. The difference of the results estimates the remaining
/// error and decides where the next samples go. The picture is the mean of both results. Differences from the
/// publication: a tenth of the samples is distributed uniformly, and the remaining noise is not filtered a
/// second time.
/// Source:  Rousselle, Knaus & Zwicker 2012, "Adaptive Rendering with Non-Local Means Filtering".
RenderMethod AdaptiveNonLocalMeansMethod();

}  // namespace lumifold::charts
