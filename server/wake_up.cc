#include "server/wake_up.h"

#include <algorithm>
#include <chrono>

namespace lumifold::server {
namespace {

// Longer waits would overflow the clock's type.
constexpr absl::Duration kLongestWait = absl::Hours(1);

}  // namespace

void WakeUp::Wake() {
  const std::lock_guard lock(mutex_);
  is_woken_ = true;
  woken_.notify_one();
}

void WakeUp::Wait(absl::Duration timeout) {
  std::unique_lock lock(mutex_);
  const auto wait = absl::ToChronoNanoseconds(std::min(timeout, kLongestWait));
  woken_.wait_until(lock, std::chrono::steady_clock::now() + wait, [this] { return is_woken_; });
  is_woken_ = false;
}

}  // namespace lumifold::server
