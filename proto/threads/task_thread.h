#pragma once

#include <deque>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace lumifold::threads {

/// Runs tasks for which nobody waits one after the other on a thread of its own.
/// Threads: safe. A task may add tasks.
class TaskThread {
 public:
  enum class Priority {
    kNormal,
    /// Lowest for processor and disk. For tasks that take no lock that others need, such as the deletion of
    /// large files: while it has one, others would wait for the lowest priority too.
    kLowest,
  };

  explicit TaskThread(Priority priority);
  ~TaskThread() { Stop(); }

  /// No effect after Stop.
  void Run(std::function<void()> task);
  /// Waits for the running task. The others are dropped: what they do must be found undone at the next start.
  void Stop();
  /// Waits until all tasks have run. For tests.
  void Drain();

 private:
  void RunTasks(Priority priority);
  bool HasWork() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return stopping_ || !tasks_.empty(); }
  bool IsIdle() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !running_ && tasks_.empty(); }

  absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  bool running_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;  // last member: it uses the members above
};

}  // namespace lumifold::threads
