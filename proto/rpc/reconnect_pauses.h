#pragma once

#include "absl/time/time.h"
#include "proto/retry/pauses.h"

namespace lumifold::rpc {

/// Pauses between tries to reach a peer, of our own retries and of gRPC's. The longest pause bounds how late
/// a worker comes back after an outage; half of it doubles the connection attempts that a farm makes to a
/// coordinator that is away.
inline constexpr retry::Pauses kReconnectPauses = {.first = absl::Milliseconds(200),
                                                   .longest = absl::Seconds(5)};

}  // namespace lumifold::rpc
