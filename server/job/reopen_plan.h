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
  /// The frames are skipped instead, see v1::RetryJobRequest.
  bool skip = false;
};

/// A job as it is.
struct ReopenedJob {
  v1::JobSpec spec;  // normalised
  v1::JobState state = v1::JOB_STATE_UNSPECIFIED;
  /// All frames of the job, and those whose result is written; both ascending.
  std::vector<int32_t> frames;
  std::vector<int32_t> finished;
  v1::Gaps gaps = {};
};

/// Which frames of a job become unfinished and which of their units are kept. All ways to continue a job are
/// this one mechanism: its spec may change, frames are reopened, and the units that still fit are kept.
class ReopenPlan {
 public:
  /// Nothing named, on a job that failed, was cancelled or is done with gaps: it goes on where it was, and
  /// skips nothing. Nothing named, on a job that is done: all of it is rendered again. A request that is
  /// already met, and a request without parts on an active job, change nothing. Errors: kInvalidArgument for
  /// fewer samples than the job has, for a frame that it does not have, for a region outside the picture, for
  /// a spec that exceeds a limit, for frames to skip in too many ranges, and for skipping all.
  static absl::StatusOr<ReopenPlan> Make(const ReopenedJob& job, const ReopenRequest& request);

  bool ChangesNothing() const { return frames_.empty() && !changes_gaps_; }
  /// The spec from now on.
  const v1::JobSpec& spec() const { return spec_; }
  /// Frames that are not finished from now on and not skipped, ascending: those that the request names and
  /// those that were not finished.
  const std::vector<int32_t>& frames() const { return frames_; }
  /// From now on; without a frame that failed.
  const v1::Gaps& gaps() const { return gaps_; }
  /// Frames whose units the ledger is to forget: frames() and those that are skipped from now on, whose units
  /// stay in their logs.
  const std::vector<int32_t>& forgotten_frames() const { return forgotten_; }
  /// Frames among them that make no sense without their units: the request wants to keep what they have.
  const std::vector<int32_t>& frames_that_need_film() const { return need_film_; }
  /// Whether a committed unit of one of the frames stays committed.
  bool Keeps(const UnitKey& key) const;
  /// Which units of one of the frames are kept, for callers that need not look at each.
  enum class Kept { kNone, kSome, kAll };
  Kept KeptOf(int32_t frame) const;

 private:
  ReopenPlan(const v1::JobSpec& before, v1::JobSpec spec);
  /// Sets `gaps_`. `named`: frames that the request names.
  absl::Status PlanGaps(const ReopenedJob& job, const ReopenRequest& request, const std::set<int32_t>& named,
                        bool goes_on);
  void PlanFrames(const ReopenedJob& job, const ReopenRequest& request, const std::set<int32_t>& named);

  v1::JobSpec spec_;
  FrameUnits before_;
  FrameUnits after_;
  std::vector<int32_t> frames_;
  std::vector<int32_t> need_film_;
  std::vector<int32_t> forgotten_;
  v1::Gaps gaps_;
  bool changes_gaps_ = false;
  std::set<int32_t> again_frames_;
  std::optional<std::set<int32_t>> again_tiles_;  // nullopt: all
};

}  // namespace lumifold::job
