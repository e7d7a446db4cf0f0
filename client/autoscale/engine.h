#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/autoscale/policy/types.h"

namespace lumifold::autoscale {

/// What places workers: Slurm. All state is the engine's own, so that any number of autoscalers, and one
/// that was restarted, see the same; a request that two of them make at a time is made once.
/// Errors of every call: kUnavailable when the engine does not answer in time; kPermissionDenied when it does
/// not know or admit the caller; kDataLoss for an answer that is not understood; kInternal for the rest. All
/// have the engine's words.
/// Threads: one call at a time.
class Engine {
 public:
  virtual ~Engine() = default;

  /// All requests of this farm, with those that ended lately where the engine tells.
  virtual absl::StatusOr<EngineState> Snapshot() = 0;
  /// Asks for `count` more workers than `seen` shows.
  virtual absl::Status Start(const EngineState& seen, int count) = 0;
  /// Ends requests of `seen`: pending ones at once, running ones with SIGTERM. What has gone or begun to run
  /// meanwhile is no error.
  virtual absl::Status Release(const EngineState& seen, const std::vector<std::string>& ids) = 0;
};

}  // namespace lumifold::autoscale
