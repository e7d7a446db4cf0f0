#include "proto/threads/event.h"

#include <algorithm>
#include <chrono>

namespace lumifold::threads {
namespace {

// Longer waits would overflow the clock's type.
constexpr absl::Duration kLongestWait = absl::Hours(1);

}  // namespace

void Event::Notify() {
  const std::lock_guard lock(mutex_);
  notified_ = true;
  changed_.notify_all();
}

bool Event::WaitWithLock(std::unique_lock<std::mutex>* lock, absl::Duration timeout) const {
  const auto wait = absl::ToChronoNanoseconds(std::min(timeout, kLongestWait));
  return changed_.wait_until(*lock, std::chrono::steady_clock::now() + wait, [this] { return notified_; });
}

bool Event::WaitFor(absl::Duration timeout) const {
  std::unique_lock lock(mutex_);
  return WaitWithLock(&lock, timeout);
}

bool Event::Consume(absl::Duration timeout) {
  std::unique_lock lock(mutex_);
  const bool happened = WaitWithLock(&lock, timeout);
  notified_ = false;
  return happened;
}

}  // namespace lumifold::threads
