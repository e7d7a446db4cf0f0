#pragma once

#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// True for DONE, DONE_WITH_GAPS, FAILED and CANCELLED.
bool HasEnded(v1::JobState state);
/// True for DONE and DONE_WITH_GAPS.
bool IsDone(v1::JobState state);

}  // namespace lumifold::job
