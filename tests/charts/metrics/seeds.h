#pragma once

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// MSE255, split into the part that differs between seeds and the part that all seeds share.
struct SeedError {
  double variance = 0;
  double bias_squared = 0;  // may be negative: it is an unbiased estimate
};

/// Means over pixels and channels, in squared 8-bit sRGB steps: the variance of the pictures, and the squared
/// difference of their mean from the reference minus the variance of that mean. bias_squared includes the
/// noise of the reference: subtract Mse255Noise.
/// Shapes:  W x H, 3 planes each, one size, at least one pixel.
/// Errors:  kInvalidArgument for fewer than two pictures.
/// Threads: safe concurrently.
absl::StatusOr<SeedError> MeasureSeeds(absl::Span<const ConstColorView> pictures,
                                       const ConstColorView& reference, float exposure = 1.0f);

}  // namespace lumifold::metrics
