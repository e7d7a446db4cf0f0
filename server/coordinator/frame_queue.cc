#include "server/coordinator/frame_queue.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumifold::server {
namespace {

/// A frame that failed this often, of a cause that may go away, fails its job.
constexpr int kMaxFailures = 3;
constexpr double kPauseGrowth = 4;
/// Longest pause before a frame that found the disk full is tried again, and the growths that lead to it at
/// most.
constexpr absl::Duration kLongestPause = absl::Minutes(1);
constexpr int kMaxGrowths = 20;

}  // namespace

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
  frame->not_before = now + pause_ * std::pow(kPauseGrowth, frame->failures - 1);
  waiting_.push_back(*frame);
  return true;
}

void FrameQueue::AwaitStorage(DueFrame* frame, absl::Time now) {
  const int growths = std::min(frame->waits++, kMaxGrowths);
  frame->not_before = now + std::min(kLongestPause, pause_ * std::pow(kPauseGrowth, growths));
  waiting_.push_back(*frame);
}

void FrameQueue::MarkStale(const FrameKey& frame) {
  if (current_.has_value() && current_->frame == frame) current_->is_stale = true;
}

void FrameQueue::ForgetJob(const job::JobId& job) {
  std::erase_if(waiting_, [&job](const DueFrame& frame) { return frame.job == job; });
}

}  // namespace lumifold::server
