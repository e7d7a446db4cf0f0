#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

// The noise of a rendered reference adds to every error measured against it. It follows from the reference's
// two halves of equal sample counts: the variance of their mean is a quarter of their mean squared
// difference. Subtract the result of these functions from the metric of the same name.
// Shapes: W x H, 3 planes each, one size.
// Threads: safe concurrently.

/// The noise in Mse255, at the same exposure.
double Mse255Noise(const ConstColorView& half_a, const ConstColorView& half_b, float exposure = 1.0f);

/// The noise in RelMse.
double RelMseNoise(const ConstColorView& half_a, const ConstColorView& half_b);

}  // namespace lumifold::metrics
