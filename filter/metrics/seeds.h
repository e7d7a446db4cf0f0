#pragma once

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// The two parts of MSE255: what differs from seed to seed, and what all seeds have in common.
struct SeedError {
  double variance = 0;
  double bias_squared = 0;  // may fall below 0 by chance: it is an estimate without bias of its own
};

/// Mean over pixels and channels of the variance of pictures of different seeds, and of the squared distance
/// of their mean from the reference less what that mean's own variance adds; in squared 8-bit sRGB steps. The
/// reference's noise is in bias_squared: take Mse255Noise off.
/// Shapes:  W x H, 3 planes each, one size, at least one pixel.
/// Errors:  kInvalidArgument for fewer than two pictures.   Threads: safe concurrently.
absl::StatusOr<SeedError> MeasureSeeds(absl::Span<const ConstColorView> pictures,
                                       const ConstColorView& reference, float exposure = 1.0f);

}  // namespace lumifold::metrics
