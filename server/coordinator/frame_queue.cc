#include "server/coordinator/frame_queue.h"

#include <algorithm>
#include <utility>

namespace lumifold::server {
namespace {

/// A frame that failed this often, of a cause that may go away, fails its job.
constexpr int kMaxFailures = 3;
constexpr double kPauseGrowth = 4;
/// Longest pause before a frame that found the disk full is tried again.
constexpr absl::Duration kLongestPause = absl::Minutes(1);

}  // namespace

FrameQueue::FrameQueue(absl::Duration pause)
    : after_failures_{.first = pause, .factor = kPauseGrowth},
      for_storage_{.first = pause, .longest = kLongestPause, .factor = kPauseGrowth} {}

void FrameQueue::Push(DueFrame frame) {
  has_news_ = true;
  const bool is_queued = std::any_of(waiting_.begin(), waiting_.end(), [&](const DueFrame& queued) {
    return queued.key() == frame.key() && queued.round == frame.round;
  });
  if (!is_queued) waiting_.push_back(std::move(frame));
}

bool FrameQueue::TakeNews() { return std::exchange(has_news_, false); }

std::optional<DueFrame> FrameQueue::TakeDue(absl::Time now) {
  const auto due = std::find_if(waiting_.begin(), waiting_.end(),
                                [now](const DueFrame& frame) { return frame.not_before <= now; });
  if (due == waiting_.end()) return std::nullopt;
  DueFrame frame = std::move(*due);
  waiting_.erase(due);
  return frame;
}

absl::Time FrameQueue::NextDue(absl::Time now) const {
  absl::Time next = absl::InfiniteFuture();
  for (const DueFrame& frame : waiting_) {
    if (frame.not_before > now) next = std::min(next, frame.not_before);
  }
  return next;
}

bool FrameQueue::Retry(DueFrame* frame, absl::Time now) {
  if (++frame->failures == kMaxFailures) return false;
  frame->not_before = now + after_failures_.After(frame->failures);
  waiting_.push_back(*frame);
  return true;
}

void FrameQueue::AwaitStorage(DueFrame* frame, absl::Time now) {
  frame->not_before = now + for_storage_.After(++frame->waits);
  waiting_.push_back(*frame);
}

void FrameQueue::MarkStale(const FrameKey& frame) {
  if (current_.has_value() && current_->frame == frame) current_->is_stale = true;
}

void FrameQueue::ForgetJob(const job::JobId& job) {
  std::erase_if(waiting_, [&job](const DueFrame& frame) { return frame.job == job; });
}

}  // namespace lumifold::server
