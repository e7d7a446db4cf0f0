#pragma once

#include <functional>

#include "absl/time/time.h"
#include "proto/retry/schedule.h"
#include "proto/rpc/retry.h"

namespace lumifold::client {

/// Pauses between the tries of an operation without a time limit, such as following a job or a download, that
/// is retried as long as it makes progress. They are rpc::kReconnectPauses.
class Backoff {
 public:
  /// Pause() returns false when `max_idle` has passed without progress.
  Backoff(absl::Duration max_idle, rpc::RetryEnvironment time, std::function<bool()> interrupted);

  /// Records progress: the next pause is short, and max_idle starts again.
  void Reset();

  /// Waits before the next try, longer each time. False when the caller should give up: after max_idle, or
  /// when the user interrupts.
  bool Pause();

 private:
  const absl::Duration max_idle_;
  const rpc::RetryEnvironment time_;
  const std::function<bool()> interrupted_;
  absl::Time last_progress_;
  retry::Schedule schedule_;
};

}  // namespace lumifold::client
