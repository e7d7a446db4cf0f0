#pragma once

#include <compare>
#include <cstdint>
#include <string>

#include "lumifold/v1/worker.pb.h"
#include "server/job/strong_id.h"

namespace lumifold::scheduler {

using JobId = StrongId<struct JobTag, std::string>;
/// One connection of a worker: a worker that comes back is a new one.
using WorkerId = StrongId<struct WorkerTag, int64_t>;
/// Fencing token: each new lease has a higher one.
using Attempt = StrongId<struct AttemptTag, int64_t>;

/// A unit's name within its job. `frame` is the frame's number, first_frame being the first.
struct UnitKey {
  int32_t frame = 0;
  int32_t tile = 0;
  int32_t pass = 0;
  v1::UnitKind kind = v1::UNIT_KIND_PASS;

  friend auto operator<=>(const UnitKey&, const UnitKey&) = default;
};

/// A unit's name among all jobs.
struct UnitRef {
  JobId job;
  UnitKey key;

  friend auto operator<=>(const UnitRef&, const UnitRef&) = default;
};

v1::UnitId ProtoFromUnit(const UnitRef& unit);
UnitRef UnitFromProto(const v1::UnitId& id);

/// "j-abc frame 1 tile 12 pass 3" or "... geometry", for logs and errors.
std::string Describe(const UnitRef& unit);

}  // namespace lumifold::scheduler
