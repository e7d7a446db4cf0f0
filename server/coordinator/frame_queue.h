#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "absl/time/time.h"
#include "proto/retry/pauses.h"
#include "server/commit/open_logs.h"
#include "server/job/ids.h"

namespace lumifold::server {

/// A frame for which something is due: its result, or with adaptive sampling the estimate of a round.
struct DueFrame {
  job::JobId job;
  int32_t number = 0;
  /// The round whose estimate is due; kResult: the frame is committed.
  int round = kResult;
  static constexpr int kResult = -1;
  /// Render time of the job when that round was committed, and its camera samples, of all frames.
  absl::Duration rendered = {};
  int64_t samples = 0;
  /// Number of times that finishing it has failed, and when it may be tried again.
  int failures = 0;
  /// Number of times that the storage could not be written meanwhile, which is no failure of the frame.
  int waits = 0;
  absl::Time not_before = absl::InfinitePast();

  FrameKey key() const { return {job, number}; }
};

/// The frames that wait for the finisher, and the one that it has. Pure state.
/// Threads: one at a time.
class FrameQueue {
 public:
  /// `pause` follows the first failure of a frame; each further one is four times as long.
  explicit FrameQueue(absl::Duration pause);

  /// No effect where the same is queued already.
  void Push(DueFrame frame);
  /// Frames that wait may be finished now, or tried again.
  void Wake() { has_news_ = true; }
  /// Whether a frame has been queued, or Wake called, since the last call.
  bool TakeNews();
  /// Takes the first frame that may be finished now.
  std::optional<DueFrame> TakeDue(absl::Time now);
  /// When the next of those that may not be finished yet may be; InfiniteFuture if there is none.
  absl::Time NextDue(absl::Time now) const;
  /// Queues a frame again that failed, for later. False where it has failed too often.
  bool Retry(DueFrame* frame, absl::Time now);
  /// Queues a frame again whose result could not be written.
  void AwaitStorage(DueFrame* frame, absl::Time now);

  /// The finisher has this frame until End.
  void Begin(const FrameKey& frame) { current_ = Current{.frame = frame}; }
  void End() { current_.reset(); }
  bool IsFinishing(const job::JobId& job) const {
    return current_.has_value() && current_->frame.first == job;
  }
  /// Units of the frame were taken back: if the finisher has it, its result is of no use.
  void MarkStale(const FrameKey& frame);
  bool result_is_stale() const { return current_.has_value() && current_->is_stale; }

  void ForgetJob(const job::JobId& job);
  const std::deque<DueFrame>& waiting() const { return waiting_; }

 private:
  struct Current {
    FrameKey frame;
    bool is_stale = false;
  };

  const retry::Pauses after_failures_;
  const retry::Pauses for_storage_;
  std::deque<DueFrame> waiting_;
  std::optional<Current> current_;
  bool has_news_ = false;
};

}  // namespace lumifold::server
