#pragma once

#include <map>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace lumifold::worker {

/// Time that the threads of a worker have spent on leases, by job: loading scenes, rendering, and encoding
/// and sending units, those included that are not wanted in the end. A thread that works for a second adds a
/// core-second, whether or not the machine has a core for it.
/// Threads: all calls are safe concurrently.
class ThreadAccount {
 public:
  void Add(const std::string& job_id, absl::Duration spent) {
    absl::MutexLock lock(&mutex_);
    open_[job_id] += spent;
  }
  /// Removes the account of a job and returns what was spent since the last call for this job.
  absl::Duration Close(const std::string& job_id) {
    absl::MutexLock lock(&mutex_);
    const auto node = open_.extract(job_id);
    return node.empty() ? absl::ZeroDuration() : node.mapped();
  }
  /// Removes the accounts of all jobs and returns what was spent.
  std::map<std::string, absl::Duration> CloseAll() {
    absl::MutexLock lock(&mutex_);
    return std::exchange(open_, {});
  }

 private:
  absl::Mutex mutex_;
  std::map<std::string, absl::Duration> open_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::worker
