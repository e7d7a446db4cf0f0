#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "server/film/unit_log.h"
#include "server/job/ids.h"

namespace lumifold::server {

/// A frame of a job.
using FrameKey = std::pair<job::JobId, int32_t>;

/// The unit logs that are open, at most a given number: the one that was used least recently is closed for
/// another. Frames in flight may be far more than a process may have open files.
/// Threads: one at a time.
class OpenLogs {
 public:
  /// `max_open` >= 1.
  explicit OpenLogs(size_t max_open) : max_open_(max_open) {}

  /// The log of a frame, opened by `open` unless it already is. Valid until the next call. Everything in the
  /// log must be synced before the next call.
  absl::StatusOr<film::UnitLog*> Get(const FrameKey& frame,
                                     absl::FunctionRef<absl::StatusOr<film::UnitLog>()> open);
  void Close(const FrameKey& frame);
  /// Closes the logs of all frames of a job.
  void CloseAll(const job::JobId& job);

 private:
  struct Entry {
    film::UnitLog log;
    std::list<FrameKey>::iterator use;
  };

  const size_t max_open_;
  std::map<FrameKey, Entry> logs_;
  std::list<FrameKey> uses_;  // least recently used first
};

}  // namespace lumifold::server
