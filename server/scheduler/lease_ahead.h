#pragma once

#include <cstdint>

#include "absl/time/time.h"

namespace lumifold::scheduler {

/// How many leases a worker gets beyond its slots. These cover one round trip of the length of a unit: two
/// for each thread, of which one waits. A worker that is further away, or renders shorter units, would wait
/// for the network; it gets as many more as its threads render in the rest of a round trip.
/// Threads: one at a time.
class LeaseAhead {
 public:
  /// Time from a grant to the worker's answer to it.
  void AddRoundTrip(absl::Duration time);
  /// A unit took the worker this long to render, and had this many bytes.
  void AddUnit(absl::Duration rendering, uint64_t bytes);
  /// For a worker with this many slots. Bounded, by number and by the bytes that wait for the network.
  int Leases(int slots) const;

 private:
  absl::Duration round_trip_;  // zero: not known
  absl::Duration unit_time_;   // a recent mean; zero: not known
  double unit_bytes_ = 0;      // the same
};

}  // namespace lumifold::scheduler
