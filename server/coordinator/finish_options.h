#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

#include "absl/time/time.h"

namespace lumifold::server {

/// How frames are finished, and what that may take of the coordinator's machine.
struct FinishOptions {
  /// Pause before a frame whose process was killed is tried again; the next pause is four times as long.
  absl::Duration pause = absl::Seconds(5);
  /// Frames that are finished at a time. 0: as many as threads and memory hold, and one more of a user who
  /// has none among them, so that nobody waits for the end of another's long ones.
  int processes = 1;
  /// Threads that they share, >= 1. Each frame has one at least.
  int threads = 1;
  /// Where `processes` is 0: memory of all of them together. One frame is finished whatever it takes.
  uint64_t memory_bytes = 0;
  /// A frame takes no more than this; 0: no limit.
  uint64_t frame_memory_bytes = 0;
  /// Of the device that filters here (filter::FilterDevice::OtherBits): workers without them finish
  /// nothing.
  std::string other_bits = {};

  /// Frames of this memory that can be finished at a time, if there are no others.
  int PlacesFor(uint64_t bytes) const {
    if (processes > 0) return processes;
    const uint64_t by_memory = memory_bytes / std::max<uint64_t>(bytes, 1);
    return static_cast<int>(std::clamp<uint64_t>(by_memory, 1, static_cast<uint64_t>(threads)));
  }
};

}  // namespace lumifold::server
