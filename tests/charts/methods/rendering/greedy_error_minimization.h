#pragma once

#include "tests/charts/methods/rendering/render_method.h"

namespace lumifold::charts {

/// "adaptive-gem": adaptive sampling by greedy error minimisation. Each pixel is blurred by the Gaussian of a
/// bank with the smallest estimated error; the search starts at the finest and compares the variance that the
/// next one saves with the bias it adds. Samples go where the estimated error relative to brightness is
/// largest. The bank starts with the identity, so that the picture converges; the published one starts with
/// its pixel filter. Further differences from the publication, both for rare light that few samples miss: the
/// variance of a pixel with few samples is shrunk towards its neighbours', and a tenth of the samples is
/// distributed uniformly.
/// Source:  Rousselle, Knaus & Zwicker 2011, "Adaptive Sampling and Reconstruction using Greedy Error
///          Minimization".
RenderMethod GreedyErrorMinimizationMethod();

}  // namespace lumifold::charts
