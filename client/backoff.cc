#include "client/backoff.h"

#include <algorithm>
#include <utility>

namespace lumifold::client {
namespace {

constexpr absl::Duration kFirstPause = absl::Milliseconds(200);
constexpr absl::Duration kLongestPause = absl::Seconds(5);
// Pauses are slept in pieces, so that Ctrl-C need not wait.
constexpr absl::Duration kPiece = absl::Milliseconds(100);

}  // namespace

Backoff::Backoff(absl::Duration patience, rpc::RetryEnvironment time, std::function<bool()> interrupted)
    : patience_(patience), time_(std::move(time)), interrupted_(std::move(interrupted)) {
  Reset();
}

void Backoff::Reset() {
  moved_at_ = time_.now();
  pause_ = kFirstPause;
}

bool Backoff::Pause() {
  if (time_.now() - moved_at_ >= patience_) return false;
  absl::Duration left = pause_ * (1.0 - 0.5 * time_.jitter());
  for (; left > absl::ZeroDuration() && !interrupted_(); left -= kPiece) time_.sleep(std::min(left, kPiece));
  pause_ = std::min(pause_ * 2, kLongestPause);
  return !interrupted_();
}

}  // namespace lumifold::client
