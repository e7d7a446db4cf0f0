#pragma once

#include <array>
#include <cstddef>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace lumifold::worker {

/// What a render thread does.
enum class Activity {
  kWaiting,    // for a lease
  kRendering,  // or fetching what it renders
  kSending,    // encodes a unit and hands it to the connection
};

/// Time that the threads of a worker have spent in each activity, up to now: not only what they have
/// finished. The sum is the number of threads times the worker's age. Times are those of one clock that never
/// goes back.
/// Threads: safe concurrently.
class ThreadActivities {
 public:
  using Times = std::array<absl::Duration, 3>;  // by Activity

  /// All threads wait.
  ThreadActivities(int threads, absl::Time now) : threads_{threads, 0, 0}, last_(now) {}

  /// A thread goes over from one activity to another.
  void Change(Activity from, Activity to, absl::Time now) {
    absl::MutexLock lock(&mutex_);
    Advance(now);
    --threads_[static_cast<size_t>(from)];
    ++threads_[static_cast<size_t>(to)];
  }

  Times Spent(absl::Time now) {
    absl::MutexLock lock(&mutex_);
    Advance(now);
    return spent_;
  }

 private:
  void Advance(absl::Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (now <= last_) return;  // another thread was faster
    for (size_t i = 0; i < spent_.size(); ++i) spent_[i] += threads_[i] * (now - last_);
    last_ = now;
  }

  absl::Mutex mutex_;
  std::array<int, 3> threads_ ABSL_GUARDED_BY(mutex_);
  Times spent_ ABSL_GUARDED_BY(mutex_) = {};
  absl::Time last_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::worker
