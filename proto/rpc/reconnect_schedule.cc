#include "proto/rpc/reconnect_schedule.h"

#include <algorithm>

namespace lumifold::rpc {

absl::Duration ReconnectSchedule::NextPause() {
  const absl::Duration pause = pause_ * (1.0 - 0.5 * jitter_());
  pause_ = std::min(2 * pause_, kLongestReconnectPause);
  return pause;
}

}  // namespace lumifold::rpc
