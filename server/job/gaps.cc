#include "server/job/gaps.h"

#include <algorithm>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"

namespace lumifold::job {
namespace {

/// Skipped frames that say nothing about the job's others. Twice as many let a job without any good frame
/// cost twice as much, half as many let one end that begins with a few bad ones.
constexpr int kFewFrames = 10;

}  // namespace

std::vector<int32_t> SkippedFrames(const v1::Gaps& gaps) {
  std::vector<int32_t> frames;
  for (const v1::FrameRange& range : gaps.skipped()) {
    for (int32_t i = 0; i < range.count() && frames.size() < size_t{kMaxFrames}; ++i)
      frames.push_back(range.first() + i);
  }
  return frames;
}

int CountSkipped(const v1::Gaps& gaps) {
  int count = 0;
  for (const v1::FrameRange& range : gaps.skipped())
    count += std::clamp(range.count(), 0, kMaxFrames - count);
  return count;
}

bool IsSkipped(const v1::Gaps& gaps, int32_t frame) {
  const auto next =
      std::upper_bound(gaps.skipped().begin(), gaps.skipped().end(), frame,
                       [](int32_t wanted, const v1::FrameRange& range) { return wanted < range.first(); });
  return next != gaps.skipped().begin() &&
         int64_t{frame} - std::prev(next)->first() < std::prev(next)->count();
}

std::string TextOf(const v1::Gaps& gaps) {
  std::string text;
  for (const v1::FrameRange& range : gaps.skipped()) {
    absl::StrAppend(&text, text.empty() ? "" : ",", range.first());
    if (range.count() > 1) absl::StrAppend(&text, "-", int64_t{range.first()} + range.count() - 1);
  }
  return text;
}

void SetSkipped(absl::Span<const int32_t> frames, v1::Gaps* gaps) {
  gaps->clear_skipped();
  for (const int32_t frame : frames) {
    v1::FrameRange* last = gaps->skipped_size() == 0 ? nullptr : &*gaps->mutable_skipped()->rbegin();
    if (last == nullptr || last->first() + last->count() != frame) {
      last = gaps->add_skipped();
      last->set_first(frame);
    }
    last->set_count(last->count() + 1);
  }
}

bool MaySkipAnother(int skipped, int finished, int frames) {
  return skipped + 1 < frames && (skipped < kFewFrames || skipped < finished);
}

}  // namespace lumifold::job
