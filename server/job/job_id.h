#pragma once

#include <cstdint>

#include "absl/time/time.h"
#include "server/job/unit.h"

namespace lumifold::ledger {

/// "j-" and 13 lower-case digits of Crockford's base 32: 45 bits of milliseconds since 1970, then 20 of
/// `random`. Ids sort by time.
scheduler::JobId MakeJobId(absl::Time now, uint64_t random);

}  // namespace lumifold::ledger
