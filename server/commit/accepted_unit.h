#pragma once

#include <cstdint>
#include <string>

#include "absl/time/time.h"
#include "server/film/unit_record.h"
#include "server/job/ids.h"

namespace lumifold::server {

/// An accepted unit that is to be committed.
struct AcceptedUnit {
  film::EncodedUnit stored;
  job::WorkerId worker;
  std::string worker_name;
  /// Camera samples of the unit, as counted by the scheduler.
  int64_t samples = 0;
  /// For the row of the job: its numeric class and the time of its first lease.
  std::string numeric_class;
  absl::Time started;
  /// When it arrived, by the clock on the wall.
  absl::Time accepted;
  /// Size of its record in the log; set when it is written.
  uint64_t record_bytes = 0;
};

}  // namespace lumifold::server
