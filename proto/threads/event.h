#pragma once

#include <condition_variable>
#include <mutex>

#include "absl/time/time.h"

namespace lumifold::threads {

/// An event that threads wait for. Like absl::Notification, but it waits by the monotonic clock: timed waits
/// of absl end by the wall clock, which may be set back.
/// Threads: safe.
class Event {
 public:
  Event() = default;
  Event(const Event&) = delete;
  Event& operator=(const Event&) = delete;

  /// The event has happened: all waits end. No effect until it is consumed, if ever.
  void Notify();
  bool HasBeenNotified() const { return WaitFor(absl::ZeroDuration()); }
  /// Waits at most `timeout`, up to an hour. Whether the event has happened.
  bool WaitFor(absl::Duration timeout) const;
  /// The same for the one thread that acts on an event that happens again and again: it has not happened
  /// afterwards.
  bool Consume(absl::Duration timeout);

 private:
  bool WaitWithLock(std::unique_lock<std::mutex>* lock, absl::Duration timeout) const;

  // Of the standard library: absl::Mutex waits by the wall clock.
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  bool notified_ = false;  // guarded by mutex_
};

}  // namespace lumifold::threads
