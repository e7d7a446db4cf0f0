#pragma once

#include <set>
#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// Defaults for the fields of a spec that are 0. A pass has at least kMinDefaultPassSamples samples, and more
/// where a tile would have more than kDefaultMaxPasses passes: each pass costs the overhead of a unit and its
/// space on disk.
inline constexpr int kDefaultTileSize = 32;
inline constexpr int kMinDefaultPassSamples = 64;
inline constexpr int kDefaultMaxPasses = 16;
/// One sample for each half: the least that can be filtered.
inline constexpr int kFirstPassSamples = 2;

/// Default frame rate: that of cinema film and of most animation programs.
inline constexpr double kDefaultFramesPerSecond = 24;

/// Sets the samples of passes, and those of pass 0, which is seen early, unless they are set.
void SetPassSamples(int pass_samples, v1::JobSpec* spec);

/// Checks a spec and fills in frames_per_second and the filter's method where they are 0 or empty, and,
/// unless the job needs a plan (server/job/plan.h), tile_size and the samples of passes. A job that models
/// everything gets its plan. The result determines every bit of the picture; the scheduler takes normalised
/// specs only. The name of the method and the checksums of the assets are not checked here.
/// Errors: kInvalidArgument naming the field, its value and the allowed range (server/job/limits.h).
absl::StatusOr<v1::JobSpec> NormaliseJobSpec(v1::JobSpec spec);

/// SHA-256 of all files of a scene.
std::set<std::string> FilesOf(const v1::SceneRef& scene);

}  // namespace lumifold::job
