#include "proto/retry/schedule.h"

namespace lumifold::retry {

absl::Duration Schedule::Next() {
  const absl::Duration pause = pauses_.After(++failures_);
  return jitter_ ? pause * (1.0 - 0.5 * jitter_()) : pause;
}

}  // namespace lumifold::retry
