#pragma once

#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// True for DONE, FAILED and CANCELLED.
bool HasEnded(v1::JobState state);

}  // namespace lumifold::job
