#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/logging/front_logger.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

/// Events that are kept of all jobs and workers, and bytes of their texts; about an hour of a busy farm at level info.
/// Half of it forgets sooner; twice as much costs the memory.
inline constexpr size_t kMaxEvents = 50'000;
inline constexpr size_t kMaxEventBytes = size_t{16} << 20;

/// The last lines of the coordinator's log that name a job or a worker, in memory: the oldest are dropped.
/// Threads: safe.
class EventLog {
 public:
  explicit EventLog(size_t max_events = kMaxEvents, size_t max_bytes = kMaxEventBytes)
      : max_events_(max_events), max_bytes_(max_bytes) {}

  /// Keeps a line if its fields name a job (logging::JobOf) or a worker (`worker`: ID/NAME).
  void Add(const logging::PassedLine& line);

  /// The last `limit` events of a job, oldest first.
  std::vector<v1::LogEvent> OfJob(const std::string& job_id, int limit) const;
  /// The same for a worker, by its id or its name. An id has the events of one connection, a name those of all.
  std::vector<v1::LogEvent> OfWorker(const std::string& worker, int limit) const;

 private:
  struct Event {
    v1::LogEvent event;
    std::string job;
    std::string worker_id;
    std::string worker_name;
    size_t bytes() const { return event.text().size() + job.size() + worker_id.size() + worker_name.size(); }
  };

  template <typename Condition>
  std::vector<v1::LogEvent> Last(int limit, Condition condition) const;

  const size_t max_events_;
  const size_t max_bytes_;
  mutable absl::Mutex mutex_;
  std::deque<Event> events_ ABSL_GUARDED_BY(mutex_);  // oldest first
  size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

/// A logger that passes lines on to `log` as MakeFrontLogger, and those at info and above also to `events`, which must
/// outlive it.
std::shared_ptr<spdlog::logger> MakeEventLogger(const std::shared_ptr<spdlog::logger>& log, EventLog* events);

}  // namespace lumifold::server
