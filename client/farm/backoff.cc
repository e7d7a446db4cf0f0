#include "client/farm/backoff.h"

#include <algorithm>
#include <utility>

#include "proto/rpc/reconnect_pauses.h"

namespace lumifold::client {
namespace {

// Pauses are divided into steps, so that Ctrl-C is noticed soon.
constexpr absl::Duration kSleepStep = absl::Milliseconds(100);

}  // namespace

Backoff::Backoff(absl::Duration max_idle, rpc::RetryEnvironment time, std::function<bool()> interrupted)
    : max_idle_(max_idle),
      time_(std::move(time)),
      interrupted_(std::move(interrupted)),
      last_progress_(time_.now()),
      schedule_(rpc::kReconnectPauses, time_.jitter) {}

void Backoff::Reset() {
  last_progress_ = time_.now();
  schedule_.Reset();
}

bool Backoff::Pause() {
  if (time_.now() - last_progress_ >= max_idle_) return false;
  absl::Duration left = schedule_.Next();
  for (; left > absl::ZeroDuration() && !interrupted_(); left -= kSleepStep)
    time_.sleep(std::min(left, kSleepStep));
  return !interrupted_();
}

}  // namespace lumifold::client
