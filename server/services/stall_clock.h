#pragma once

#include <algorithm>
#include <cstdint>

#include "absl/time/time.h"

namespace lumifold::server {

/// How long a stream may still wait for its other end. Only time counts in which it is the other end's turn,
/// so that a slow disk of the coordinator is held against nobody; and a few bytes now and then do not count
/// as progress.
/// Threads: one at a time.
class StallClock {
 public:
  /// In `limit` of its turns the other end must move `bytes`.
  StallClock(absl::Duration limit, uint64_t bytes) : limit_(limit), bytes_(bytes), left_(limit) {}

  /// It is the other end's turn; returns the time at which the stream will have stalled.
  absl::Time Await(absl::Time now) {
    since_ = now;
    return now + left_;
  }
  /// Its turn is over: it has moved `bytes`.
  void Move(absl::Time now, uint64_t bytes) {
    missing_ -= std::min(missing_, bytes);
    left_ -= now - since_;
    if (missing_ == 0) Restart();
  }
  /// Its turn is over, and what it did was enough.
  void Restart() {
    missing_ = bytes_;
    left_ = limit_;
  }

 private:
  const absl::Duration limit_;
  const uint64_t bytes_;
  uint64_t missing_ = bytes_;
  absl::Duration left_;
  absl::Time since_ = absl::InfiniteFuture();
};

}  // namespace lumifold::server
