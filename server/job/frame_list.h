#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// The frames of a job: first_frame and frame_count of its spec, and more_frames. A frame has a number, which
/// the scene's animation sees, and an index from 0 in ascending order of the numbers.
/// Threads: safe.
class FrameList {
 public:
  /// Errors: kInvalidArgument naming the field, unless there are 1 to kMaxFrames frames in at most
  /// kMaxFrameRanges ascending ranges besides the first one that do not overlap.
  static absl::Status Check(const v1::JobSpec& spec);

  /// Of a spec that Check accepts. Of any other it holds some frames, at most kMaxFrames.
  explicit FrameList(const v1::JobSpec& spec);

  int count() const { return count_; }
  /// `index` is in [0, count()). O(log ranges), as the inverse is.
  int32_t NumberOf(int index) const;
  /// nullopt for a number that is not among the frames.
  std::optional<int> IndexOf(int32_t number) const;

 private:
  struct Range {
    int32_t first = 0;
    int count = 0;
    int index = 0;  // of `first`
  };

  std::vector<Range> ranges_;  // ascending
  int count_ = 0;
};

}  // namespace lumifold::job
