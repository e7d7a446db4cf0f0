#pragma once

#include "tests/charts/methods/samples/sample_method.h"

namespace lumifold::charts {

/// "statistical": the mean of the pixels around each one that Welch's t-test does not tell from it, in any of
/// three colour channels, weighted by place, albedo and normal. The test compares means of samples under a
/// Box-Cox transform, corrected for their skewness (Johnson 1978); its level is 0.005. Pixels of one sample
/// stay as they are: one sample has no variance.
/// Source:  Sakai et al. 2024, "A Statistical Approach to Monte Carlo Denoising", with the parameters of its
///          authors' scenes.
/// Differs: samples are stratified, which the test takes for independent ones: their variance comes out too
///          large, and more passes for equal.
SampleMethod StatisticalMethod();

}  // namespace lumifold::charts
