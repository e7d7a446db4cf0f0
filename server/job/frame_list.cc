#include "server/job/frame_list.h"

#include <algorithm>
#include <limits>
#include <string>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "server/job/limits.h"

namespace lumifold::job {
namespace {

/// So that no number past the end of a range overflows.
constexpr int64_t kLastFrame = std::numeric_limits<int32_t>::max() - int64_t{kMaxFrames};

absl::Status CheckRange(const std::string& field, int64_t value, int64_t low, int64_t high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(field, " is ", value, ", not ", low, " to ", high));
}

}  // namespace

absl::Status FrameList::Check(const v1::JobSpec& spec) {
  absl::Status status = CheckRange("first_frame", spec.first_frame(), -kLastFrame, kLastFrame);
  status.Update(CheckRange("frame_count", spec.frame_count(), 1, kMaxFrames));
  status.Update(CheckRange("the number of more_frames", spec.more_frames_size(), 0, kMaxFrameRanges));
  if (!status.ok()) return status;
  int64_t end = int64_t{spec.first_frame()} + spec.frame_count();
  int64_t total = spec.frame_count();
  for (int i = 0; i < spec.more_frames_size(); ++i) {
    const v1::FrameRange& range = spec.more_frames(i);
    const std::string field = absl::StrCat("more_frames[", i, "]");
    status.Update(CheckRange(absl::StrCat(field, ".first"), range.first(), end, kLastFrame));
    status.Update(CheckRange(absl::StrCat(field, ".count"), range.count(), 1, kMaxFrames));
    if (!status.ok()) return status;
    end = int64_t{range.first()} + range.count();
    total += range.count();
  }
  return CheckRange("the number of frames", total, 1, kMaxFrames);
}

FrameList::FrameList(const v1::JobSpec& spec) {
  const auto add = [this](int32_t first, int32_t count) {
    const int kept = std::min(count, kMaxFrames - count_);
    if (kept < 1) return;
    ranges_.push_back({first, kept, count_});
    count_ += kept;
  };
  add(spec.first_frame(), spec.frame_count());
  for (const v1::FrameRange& range : spec.more_frames()) add(range.first(), range.count());
}

int32_t FrameList::NumberOf(int index) const {
  LUMIFOLD_CHECK(index >= 0 && index < count_);
  const auto next = std::upper_bound(ranges_.begin(), ranges_.end(), index,
                                     [](int wanted, const Range& range) { return wanted < range.index; });
  const Range& range = *std::prev(next);
  return range.first + (index - range.index);
}

std::optional<int> FrameList::IndexOf(int32_t number) const {
  const auto next = std::upper_bound(ranges_.begin(), ranges_.end(), number,
                                     [](int32_t wanted, const Range& range) { return wanted < range.first; });
  if (next == ranges_.begin()) return std::nullopt;
  const Range& range = *std::prev(next);
  const int64_t offset = int64_t{number} - range.first;
  return offset < range.count ? std::optional(range.index + static_cast<int>(offset)) : std::nullopt;
}

}  // namespace lumifold::job
