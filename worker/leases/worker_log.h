#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/log.pb.h"
#include "proto/logging/front_logger.h"
#include "proto/logging/job_labels.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::worker {

/// The last lines of the worker's log that the coordinator has not got: at most rpc::kMaxTailLines, of
/// rpc::kMaxTailLineBytes. Longer ones are cut, older ones forgotten.
/// Threads: safe.
class LogTail {
 public:
  void Add(const logging::PassedLine& line);
  /// Oldest first; they are forgotten here.
  std::vector<v1::LogEvent> Take();

 private:
  absl::Mutex mutex_;
  std::deque<v1::LogEvent> lines_ ABSL_GUARDED_BY(mutex_);
};

/// A worker's log, and what goes with it. No pointer is null.
struct WorkerLog {
  std::shared_ptr<spdlog::logger> log;
  /// Where the traces of jobs are noted, for the lines about them.
  std::shared_ptr<logging::JobLabels> labels = std::make_shared<logging::JobLabels>();
  std::shared_ptr<LogTail> tail = std::make_shared<LogTail>();
};

/// A log whose lines go on to `log` as MakeFrontLogger says, and stay in its tail.
WorkerLog MakeWorkerLog(std::shared_ptr<spdlog::logger> log);
/// A log that writes nothing and has no tail.
WorkerLog SilentLog();

}  // namespace lumifold::worker
