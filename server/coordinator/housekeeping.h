#pragma once

#include <thread>

#include "proto/threads/event.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

/// Does what time brings: leases expire, watchers are told of changes, frames in flight follow the free disk.
/// Threads: one of its own.
class Housekeeping {
 public:
  /// All must outlive it. `wake_up` says that jobs have changed.
  Housekeeping(const Resources* resources, FarmState* state, Cleanup* cleanup, threads::Event* wake_up)
      : resources_(resources), state_(state), cleanup_(cleanup), wake_up_(wake_up) {}
  void Start();
  /// Once the farm is stopping.
  void Join();

 private:
  void Run();
  absl::Duration UntilNext() const;

  const Resources* const resources_;
  FarmState* const state_;
  Cleanup* const cleanup_;
  threads::Event* const wake_up_;
  std::thread thread_;
};

}  // namespace lumifold::server
