#include "server/job/job_state.h"

namespace lumifold::job {

bool HasEnded(v1::JobState state) {
  return IsDone(state) || state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED;
}

bool IsDone(v1::JobState state) {
  return state == v1::JOB_STATE_DONE || state == v1::JOB_STATE_DONE_WITH_GAPS;
}

}  // namespace lumifold::job
