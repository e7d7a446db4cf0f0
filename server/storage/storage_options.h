#pragma once

#include <cstddef>
#include <cstdint>

#include "absl/time/time.h"
#include "proto/retry/pauses.h"

namespace lumifold::server {

/// How the storage is written.
struct StorageOptions {
  /// Between tries while the storage cannot be written.
  retry::Pauses pauses = {.first = absl::Milliseconds(250), .longest = absl::Seconds(5)};
  /// Number of unit logs that may be open.
  size_t max_open_logs = 256;
  /// Space that is kept so that the ledger can be written when the disk is full, see Committer; 0 for none.
  uint64_t reserve_bytes = 0;
};

}  // namespace lumifold::server
