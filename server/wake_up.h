#pragma once

#include <condition_variable>
#include <mutex>

#include "absl/time/time.h"

namespace lumifold::server {

/// Lets one thread wait until it is woken, or until some time has passed by the monotonic clock. (Timed waits of
/// absl::CondVar end by the wall clock, which may be set back.)
/// Threads: Wake from any thread; Wait from one.
class WakeUp {
 public:
  /// Ends the current Wait, or else the next one.
  void Wake();
  /// Waits at most `timeout`, up to an hour.
  void Wait(absl::Duration timeout);

 private:
  std::mutex mutex_;
  std::condition_variable woken_;
  bool is_woken_ = false;  // guarded by mutex_
};

}  // namespace lumifold::server
