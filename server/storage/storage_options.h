#pragma once

#include <cstddef>
#include <cstdint>

#include "absl/time/time.h"

namespace lumifold::server {

/// How the storage is written.
struct StorageOptions {
  /// Pause after the first error of the storage; it doubles with each further one.
  absl::Duration first_pause = absl::Milliseconds(250);
  absl::Duration longest_pause = absl::Seconds(5);
  /// Number of unit logs that may be open.
  size_t max_open_logs = 256;
  /// Space that is kept so that the ledger can be written when the disk is full, see Committer; 0 for none.
  uint64_t reserve_bytes = 0;
};

}  // namespace lumifold::server
