#include "client/backoff.h"

#include <algorithm>
#include <utility>

namespace lumifold::client {
namespace {

constexpr absl::Duration kFirstPause = absl::Milliseconds(200);
constexpr absl::Duration kLongestPause = absl::Seconds(5);
// Pauses are divided into steps, so that Ctrl-C is noticed soon.
constexpr absl::Duration kSleepStep = absl::Milliseconds(100);

}  // namespace

Backoff::Backoff(absl::Duration max_idle, rpc::RetryEnvironment time, std::function<bool()> interrupted)
    : max_idle_(max_idle), time_(std::move(time)), interrupted_(std::move(interrupted)) {
  Reset();
}

void Backoff::Reset() {
  last_progress_ = time_.now();
  pause_ = kFirstPause;
}

bool Backoff::Pause() {
  if (time_.now() - last_progress_ >= max_idle_) return false;
  absl::Duration left = pause_ * (1.0 - 0.5 * time_.jitter());
  for (; left > absl::ZeroDuration() && !interrupted_(); left -= kSleepStep)
    time_.sleep(std::min(left, kSleepStep));
  pause_ = std::min(pause_ * 2, kLongestPause);
  return !interrupted_();
}

}  // namespace lumifold::client
