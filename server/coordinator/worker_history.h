#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <map>
#include <string>

#include "absl/time/time.h"
#include "server/job/ids.h"

namespace lumifold::server {

/// What a worker did for a frame, without a break by another one.
struct FrameOfWorker {
  job::JobId job;
  int32_t frame = 0;
  absl::Time first = {};
  absl::Time last = {};
  int64_t units = 0;  // committed
  int64_t failed = 0;
  absl::Duration rendering = absl::ZeroDuration();
};

/// The last frames of each worker, by name, connected or not: of at most kMaxWorkers, those that did
/// something last. Pure state. Time: O(log n) a call. Threads: one at a time.
class WorkerHistory {
 public:
  static constexpr size_t kMaxFrames = 20;
  static constexpr size_t kMaxWorkers = 2000;

  void AddUnit(const std::string& worker, const job::JobId& job, int32_t frame, absl::Time now,
               absl::Duration rendering);
  void AddFailure(const std::string& worker, const job::JobId& job, int32_t frame, absl::Time now);
  /// Oldest first.
  std::deque<FrameOfWorker> Of(const std::string& worker) const;

 private:
  struct Past {
    std::deque<FrameOfWorker> frames;
    std::list<std::string>::iterator place;  // in order_
  };

  FrameOfWorker& FrameOf(const std::string& worker, const job::JobId& job, int32_t frame, absl::Time now);

  std::map<std::string, Past> workers_;
  std::list<std::string> order_;  // by when they did something, the last one first
};

}  // namespace lumifold::server
