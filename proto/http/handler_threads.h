#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace lumifold::http {

/// Threads that start when they are needed, up to a number.
/// Threads: Run is safe.
class HandlerThreads {
 public:
  /// Starts the first one. `most` >= 1. Throws std::system_error where no thread can be started.
  explicit HandlerThreads(size_t most);
  HandlerThreads(const HandlerThreads&) = delete;
  HandlerThreads& operator=(const HandlerThreads&) = delete;
  /// Waits until all work is done.
  ~HandlerThreads();

  /// Queues work. It must not throw.
  void Run(std::function<void()> work);

 private:
  void Loop();
  bool HasWork() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return is_ending_ || !queue_.empty(); }

  const size_t most_;
  absl::Mutex mutex_;
  std::deque<std::function<void()>> queue_ ABSL_GUARDED_BY(mutex_);
  size_t idle_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_ending_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::http
