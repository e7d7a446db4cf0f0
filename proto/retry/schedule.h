#pragma once

#include <functional>
#include <utility>

#include "absl/time/time.h"
#include "proto/retry/pauses.h"

namespace lumifold::retry {

/// The pauses of one series of tries. No clock and no sleep: the caller pauses.
/// Threads: one at a time.
class Schedule {
 public:
  explicit Schedule(const Pauses& pauses) : pauses_(pauses) {}
  /// `jitter` returns random numbers in [0, 1). Each shortens a pause by up to a half, so that many callers
  /// do not return at the same time.
  Schedule(const Pauses& pauses, std::function<double()> jitter)
      : pauses_(pauses), jitter_(std::move(jitter)) {}

  /// A try has failed: the pause before the next one.
  absl::Duration Next();
  /// A try has succeeded: the next pause is the first again.
  void Reset() { failures_ = 0; }
  /// Number of failures since the last success.
  int failures() const { return failures_; }

 private:
  Pauses pauses_;
  std::function<double()> jitter_;
  int failures_ = 0;
};

}  // namespace lumifold::retry
