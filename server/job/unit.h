#pragma once

#include <compare>
#include <cstdint>
#include <string>

#include "lumifold/v1/worker.pb.h"
#include "server/job/ids.h"

namespace lumifold::job {

/// Identifies a unit within its job. `frame` is a frame number of the job, from first_frame on.
struct UnitKey {
  int32_t frame = 0;
  int32_t tile = 0;
  int32_t pass = 0;
  v1::UnitKind kind = v1::UNIT_KIND_PASS;

  // clang-tidy 14 takes the result's comparison with 0 for one of pointers.
  friend auto operator<=>(const UnitKey&, const UnitKey&) = default;  // NOLINT(modernize-use-nullptr)
};

/// Identifies a unit among all jobs.
struct UnitRef {
  JobId job;
  UnitKey key;

  // NOLINTNEXTLINE(modernize-use-nullptr): the 0 that it compares with is the compiler's
  friend auto operator<=>(const UnitRef&, const UnitRef&) = default;
};

v1::UnitId ProtoFromUnit(const UnitRef& unit);
UnitRef UnitFromProto(const v1::UnitId& id);

/// "j-abc frame 1 tile 12 pass 3", "j-abc frame 1 tile 12 geometry", "j-abc frame 1 result" or "j-abc plan",
/// for logs and errors.
std::string Describe(const UnitRef& unit);

}  // namespace lumifold::job
