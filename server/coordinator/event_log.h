#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/logging/front_logger.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

/// Events that are kept of all jobs and workers, and bytes of their texts; about an hour of a busy farm at
/// level info. Half of it forgets sooner; twice as much costs the memory.
inline constexpr size_t kMaxEvents = 50'000;
inline constexpr size_t kMaxEventBytes = size_t{16} << 20;

/// Lines of a worker's log that are kept, and bytes of their texts.
inline constexpr size_t kMaxWorkerLines = 64;
inline constexpr size_t kMaxWorkerLineBytes = size_t{16} << 10;
/// Connections of workers whose lines are kept. Those of the one that has been silent for longest are dropped
/// first.
inline constexpr size_t kMaxLoggedWorkers = 1000;

/// The last lines of the coordinator's log that name a job or a worker, in memory: the oldest are dropped.
/// And the last lines of workers' logs, so that a worker that writes much pushes out its own lines alone.
/// Threads: safe.
class EventLog {
 public:
  explicit EventLog(size_t max_events = kMaxEvents, size_t max_bytes = kMaxEventBytes)
      : max_events_(max_events), max_bytes_(max_bytes) {}

  /// Keeps a line if its fields name a job (logging::JobOf) or a worker (`worker`: ID/NAME).
  void Add(const logging::PassedLine& line);

  /// Keeps lines that `worker` (ID/NAME) has sent, as they are bounded by rpc::kMaxTailLines: text of others.
  /// They are of the job that they name if `is_known` says that the worker has it, and are not later than
  /// `now`.
  void AddOfWorker(const std::string& worker, const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines,
                   absl::Time now, absl::FunctionRef<bool(const std::string& job)> is_known);

  /// The last `limit` events of a job, oldest first.
  std::vector<v1::LogEvent> OfJob(const std::string& job_id, int limit) const;
  /// The same for a worker, by its id or its name. An id has the events of one connection, a name those of
  /// all.
  std::vector<v1::LogEvent> OfWorker(const std::string& worker, int limit) const;

 private:
  struct Event {
    v1::LogEvent event;
    std::string job;
    std::string worker_id;
    std::string worker_name;
    size_t bytes() const { return event.text().size() + job.size() + worker_id.size() + worker_name.size(); }
    void SetWorker(std::string_view worker);
  };
  /// The oldest are dropped.
  struct Events {
    std::deque<Event> events;  // in the order of Add
    size_t bytes = 0;
    void Add(Event added, size_t max_events, size_t max_bytes);
  };
  /// Of one connection.
  struct WorkerEvents {
    Events kept;
    int64_t last_added = 0;  // in the order of all workers
  };

  template <typename Condition>
  std::vector<v1::LogEvent> Last(int limit, Condition condition) const;

  const size_t max_events_;
  const size_t max_bytes_;
  mutable absl::Mutex mutex_;
  Events events_ ABSL_GUARDED_BY(mutex_);                                   // of the coordinator
  std::map<std::string, WorkerEvents> of_workers_ ABSL_GUARDED_BY(mutex_);  // by ID/NAME
  int64_t added_ ABSL_GUARDED_BY(mutex_) = 0;
};

/// A logger that passes lines on to `log` as MakeFrontLogger, with `labels`, and those at info and above also
/// to `events`, which must outlive it.
std::shared_ptr<spdlog::logger> MakeEventLogger(const std::shared_ptr<spdlog::logger>& log,
                                                std::shared_ptr<logging::JobLabels> labels, EventLog* events);

}  // namespace lumifold::server
