#pragma once

#include "absl/status/statusor.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// Variance of the error's means over 8x8 blocks, filtered over noisy. A good filter takes away what is finer
/// and leaves at most 1; more than 1 means that it made spots of its own.
struct Blotch {
  double luminance = 0;
  double chroma = 0;
};

/// Compares the errors of a filtered picture and of the noisy one it was made from, as displayed.
/// Shapes:  W x H, 3 planes each, one size; what is left over of the last blocks is not judged.
/// Result:  0 where the filtered error has no variance; infinite where the noisy one alone has none.
/// Errors:  kInvalidArgument for a picture of fewer than two blocks.   Threads: safe concurrently.
absl::StatusOr<Blotch> MeasureBlotch(const ConstColorView& filtered, const ConstColorView& noisy,
                                     const ConstColorView& reference, float exposure = 1.0f);

}  // namespace lumifold::metrics
