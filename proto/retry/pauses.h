#pragma once

#include "absl/time/time.h"

namespace lumifold::retry {

/// Pauses after failures in a row: the first, then each `factor` times as long as the one before, up to the
/// longest. Pure.
struct Pauses {
  absl::Duration first;
  absl::Duration longest = absl::InfiniteDuration();
  double factor = 2;

  /// The pause after this many failures in a row, 1 or more; never longer than `longest`.
  absl::Duration After(int failures) const;
};

}  // namespace lumifold::retry
