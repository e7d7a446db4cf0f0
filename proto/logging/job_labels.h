#pragma once

#include <cstddef>
#include <list>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace lumifold::logging {

/// What each line about a job says of it besides its id; empty: nothing.
struct JobLabel {
  std::string trace;
  std::string user = {};
  bool operator==(const JobLabel&) const = default;
};

/// The labels of jobs. Of too many jobs it forgets the one that was used least recently.
/// Threads: safe.
class JobLabels {
 public:
  /// Active jobs of a large farm, and some that have ended; some 200 bytes each.
  static constexpr size_t kMaxJobs = 65'536;

  explicit JobLabels(size_t max_jobs = kMaxJobs) : max_jobs_(max_jobs) {}

  void Set(const std::string& job, JobLabel label);
  /// Empty for a job that is not known.
  JobLabel Of(const std::string& job);

  /// Of a worker's log: the worker, ID/NAME, in all lines from now on.
  void SetWorker(std::string worker);
  std::string worker();

 private:
  struct Entry {
    JobLabel label;
    std::list<std::string>::iterator use;
  };

  const size_t max_jobs_;
  absl::Mutex mutex_;
  std::unordered_map<std::string, Entry> labels_ ABSL_GUARDED_BY(mutex_);
  std::list<std::string> uses_ ABSL_GUARDED_BY(mutex_);  // least recently used first
  std::string worker_ ABSL_GUARDED_BY(mutex_);
};

/// The job that a line is about, by its field `job`, or `unit`, whose first word is the job; empty if there
/// is none.
struct Line;
std::string JobOf(const Line& line);

}  // namespace lumifold::logging
