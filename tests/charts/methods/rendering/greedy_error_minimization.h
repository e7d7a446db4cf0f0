#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// Adaptive sampling by greedy error minimisation: each pixel is blurred by the Gaussian of a bank that seems
/// to leave the least error, found from the finest on by weighing the variance the next one saves against the
/// bias it adds; samples go where the error that is left is largest against the brightness. The bank begins
/// with the pixel itself, so that the picture converges; the published one begins with its pixel filter. Not
/// as published, and both for rare light that few samples miss: a pixel's variance is drawn to that around it
/// while its samples are few, and a tenth of the samples goes to all pixels alike.
/// Source: Rousselle, Knaus & Zwicker 2011, "Adaptive Sampling and Reconstruction using Greedy Error
/// Minimization".
RenderMethod GreedyErrorMinimizationMethod();

}  // namespace lumifold::charts
