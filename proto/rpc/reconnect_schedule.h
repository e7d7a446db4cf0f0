#pragma once

#include <functional>
#include <utility>

#include "absl/time/time.h"

namespace lumifold::rpc {

/// Limits of the pauses between tries to reach a peer, of our own retries and of gRPC's. The longest pause
/// bounds how late a worker comes back after an outage; half of it doubles the connection attempts that a
/// farm makes to a coordinator that is away.
inline constexpr absl::Duration kFirstReconnectPause = absl::Milliseconds(200);
inline constexpr absl::Duration kLongestReconnectPause = absl::Seconds(5);

/// Pauses between tries to reach a peer: each twice as long as the one before, up to the longest pause, and
/// shortened at random by up to a half, so that many callers do not return at the same time. No clock and no
/// sleep: the caller pauses.
/// Threads: one at a time.
class ReconnectSchedule {
 public:
  /// `jitter` returns random numbers in [0, 1).
  explicit ReconnectSchedule(std::function<double()> jitter) : jitter_(std::move(jitter)) {}

  /// The pause before the next try.
  absl::Duration NextPause();
  /// The peer was reached: the next pause is short again.
  void Reset() { pause_ = kFirstReconnectPause; }

 private:
  std::function<double()> jitter_;
  absl::Duration pause_ = kFirstReconnectPause;
};

}  // namespace lumifold::rpc
