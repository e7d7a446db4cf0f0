#pragma once

#include <functional>

#include "absl/time/time.h"
#include "proto/rpc/retry.h"

namespace lumifold::client {

/// The pauses between tries of something that may go on for long as long as it moves: a job that is followed,
/// a download.
class Backoff {
 public:
  /// Gives up when `patience` has passed without anything moving.
  Backoff(absl::Duration patience, rpc::RetryEnvironment time, std::function<bool()> interrupted);

  /// Something moved: pauses are short again and patience is whole.
  void Reset();

  /// Waits before the next try, longer each time. False when it is time to give up or the user wants to stop.
  bool Pause();

 private:
  const absl::Duration patience_;
  const rpc::RetryEnvironment time_;
  const std::function<bool()> interrupted_;
  absl::Time moved_at_;
  absl::Duration pause_;
};

}  // namespace lumifold::client
