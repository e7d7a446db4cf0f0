#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

// A rendered reference has noise of its own, which adds to every error measured against it. Its two halves,
// rendered with equal sample counts, tell how much: the mean of both has a quarter of their squared
// difference. What these functions give is to be taken off the metric of the same name.
// Shapes: W x H, 3 planes each, one size. Threads: safe concurrently.

/// Of Mse255, at the same exposure.
double Mse255Noise(const ConstColorView& half_a, const ConstColorView& half_b, float exposure = 1.0f);

/// Of RelMse.
double RelMseNoise(const ConstColorView& half_a, const ConstColorView& half_b);

}  // namespace lumifold::metrics
