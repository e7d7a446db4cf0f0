#pragma once

#include "absl/status/statusor.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// Low-frequency error: the variance of the error's means over 8x8 blocks, filtered over noisy. A good filter
/// gives at most 1; more than 1 means that the filter added blotches.
struct Blotch {
  double luminance = 0;
  double chroma = 0;
};

/// Compares the errors of a filtered picture and of the noisy one it was made from, as displayed.
/// Shapes:  W x H, 3 planes each, one size. Incomplete blocks at the right and bottom edge are ignored.
/// Result:  0 if the filtered error has no variance; infinite if only the noisy error has none.
/// Errors:  kInvalidArgument for a picture of fewer than two blocks.
/// Threads: safe concurrently.
absl::StatusOr<Blotch> MeasureBlotch(const ConstColorView& filtered, const ConstColorView& noisy,
                                     const ConstColorView& reference, float exposure = 1.0f);

}  // namespace lumifold::metrics
