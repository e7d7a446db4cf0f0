#pragma once

#include "absl/time/time.h"

struct gpr_timespec;

namespace lumifold::rpc {

/// The time by the monotonic clock of this machine, which nobody sets. Its origin is arbitrary: only
/// differences have a meaning. Everything that orders events or measures a duration uses it; absl::Now() is
/// the wall clock, for display alone.
absl::Time MonotonicNow();

/// The deadline of a gRPC call or wait, `timeout` from now, by the monotonic clock.
gpr_timespec MonotonicDeadline(absl::Duration timeout);

/// What is left until a deadline of gRPC's, whichever clock it is of: infinite without one, negative past it.
absl::Duration TimeUntil(gpr_timespec deadline);

}  // namespace lumifold::rpc
