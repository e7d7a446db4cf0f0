#pragma once

#include <condition_variable>
#include <mutex>

#include "absl/time/time.h"

struct gpr_timespec;

namespace lumifold::rpc {

/// The time by the monotonic clock of this machine, which nobody sets. Its origin is arbitrary: only
/// differences have a meaning. Everything that orders events or measures a duration uses it; absl::Now() is
/// the wall clock, for display alone.
absl::Time MonotonicNow();

/// The deadline of a gRPC call or wait, `timeout` from now, by the monotonic clock.
gpr_timespec MonotonicDeadline(absl::Duration timeout);

/// What is left until a deadline of gRPC's, whichever clock it is of: infinite without one, negative past it.
absl::Duration TimeUntil(gpr_timespec deadline);

/// An event that happens once and that threads wait for. Like absl::Notification, but it waits by the
/// monotonic clock.
/// Threads: safe.
class MonotonicEvent {
 public:
  MonotonicEvent() = default;
  MonotonicEvent(const MonotonicEvent&) = delete;
  MonotonicEvent& operator=(const MonotonicEvent&) = delete;

  /// The event has happened: all waits end. Later calls have no effect.
  void Notify();
  bool HasBeenNotified() const { return WaitFor(absl::ZeroDuration()); }
  /// Waits at most `timeout`, up to an hour. Whether the event has happened.
  bool WaitFor(absl::Duration timeout) const;

 private:
  // Of the standard library: absl::Mutex waits by the wall clock.
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  bool notified_ = false;  // guarded by mutex_
};

}  // namespace lumifold::rpc
