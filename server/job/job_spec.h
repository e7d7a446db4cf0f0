#pragma once

#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::scheduler {

/// What the coordinator chooses where a spec leaves it open (0): tiles of this size, passes of this many
/// samples at least, and longer ones where a tile would have more passes than kDefaultMaxPasses: each pass
/// costs a unit's overhead and its room on disk.
inline constexpr int kDefaultTileSize = 32;
inline constexpr int kMinDefaultPassSamples = 64;
inline constexpr int kDefaultMaxPasses = 16;

/// Frames a second where a spec leaves them open: the speed of film, and of programs that artists animate
/// with.
inline constexpr double kDefaultFramesPerSecond = 24;

/// Units one frame, and frames one job may have at most: what the scheduler's tables are sized for.
inline constexpr int64_t kMaxUnitsPerFrame = int64_t{1} << 27;
inline constexpr int kMaxFrames = 100'000;

/// Checks a spec and fills in tile_size, pass_samples, frames_per_second and the filter's method
/// where they are open. What comes
/// back decides every bit of the picture; the scheduler takes no other. The method's name itself and the
/// assets' sums are checked by those who know the methods and keep the assets.
/// Errors: kInvalidArgument naming the field, its value and what is allowed.
absl::StatusOr<v1::JobSpec> NormaliseJobSpec(v1::JobSpec spec);

}  // namespace lumifold::scheduler
