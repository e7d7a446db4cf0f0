#pragma once

#include <cstdint>

#include "absl/time/time.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {

/// What callers may take of the services. Those of one message are in proto/rpc/limits.h.
struct CallLimits {
  /// Streams that a caller may have open: uploads, downloads and watches, and those of WorkerService. A
  /// worker's name may stand for a room of machines, and without access control everyone at an address is one
  /// caller.
  int streams_per_person = 256;
  int streams_per_worker = 4096;
  /// A stream whose other end does not do the next step for this long, that is to send a message or to take
  /// one, is ended: its place is for those that make progress. Half as long would end those over the slowest
  /// lines, twice as long keeps places for the dead.
  absl::Duration stalled_stream = absl::Minutes(2);
  /// Of a file that is uploaded or downloaded, progress is this much: a message of full size, at 70 kbit/s.
  /// Less in each message would keep a place for ever.
  uint64_t stalled_file_bytes = rpc::kMaxChunkBytes;
  /// Calls a second of one caller, and calls at once after a pause. A worker that loads a scene fetches up to
  /// 16,384 files in a row.
  double requests_per_second = 250;
  double request_burst = 1250;
  double worker_requests_per_second = 4000;
  double worker_request_burst = 40'000;
};

}  // namespace lumifold::server
