#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/rect.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/tile_grid.h"

namespace lumifold::job {

/// What is to change in a job that exists.
struct ReopenRequest {
  /// Samples per pixel in total; nullopt: those that the job has.
  std::optional<int> samples_per_pixel = std::nullopt;
  /// Frames whose units are rendered again; empty: all.
  std::vector<int32_t> frames = {};
  /// Only units whose tiles touch this rectangle are rendered again; nullopt: all.
  std::optional<Rect> region = std::nullopt;
  /// No unit is rendered again; the results of the frames are made again.
  bool filter_only = false;
};

/// A job as it is.
struct ReopenedJob {
  v1::JobSpec spec;  // normalised
  v1::JobState state = v1::JOB_STATE_UNSPECIFIED;
  /// All frames of the job, and those whose result is written; both ascending.
  std::vector<int32_t> frames;
  std::vector<int32_t> finished;
};

/// Which frames of a job become unfinished and which of their units are kept. All ways to continue a job are
/// this one mechanism: its spec may change, frames are reopened, and the units that still fit are kept.
class ReopenPlan {
 public:
  /// Nothing named, on a job that failed or was cancelled: it goes on where it was. Nothing named, on a job
  /// that is done: all of it is rendered again. A request that is already met, and a request without parts on
  /// an active job, change nothing.
  /// Errors: kInvalidArgument for fewer samples than the job has, for a frame that it does not have, for a
  /// region outside the picture, and for a spec that exceeds a limit.
  static absl::StatusOr<ReopenPlan> Make(const ReopenedJob& job, const ReopenRequest& request);

  bool ChangesNothing() const { return frames_.empty(); }
  /// The spec from now on.
  const v1::JobSpec& spec() const { return spec_; }
  /// Frames that are not finished from now on, ascending: those that the request names and those that were
  /// not finished.
  const std::vector<int32_t>& frames() const { return frames_; }
  /// Frames among them that make no sense without their units: the request wants to keep what they have.
  const std::vector<int32_t>& frames_that_need_film() const { return need_film_; }
  /// Whether a committed unit of one of the frames stays committed.
  bool Keeps(const UnitKey& key) const;
  /// Which units of one of the frames are kept, for callers that need not look at each.
  enum class Kept { kNone, kSome, kAll };
  Kept KeptOf(int32_t frame) const;

 private:
  ReopenPlan(const v1::JobSpec& before, v1::JobSpec spec);

  v1::JobSpec spec_;
  FrameUnits before_;
  FrameUnits after_;
  std::vector<int32_t> frames_;
  std::vector<int32_t> need_film_;
  std::set<int32_t> again_frames_;
  std::optional<std::set<int32_t>> again_tiles_;  // nullopt: all
};

}  // namespace lumifold::job
