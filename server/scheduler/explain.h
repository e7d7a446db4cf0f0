#pragma once

#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Why the job does not run, or runs slowly, most important first; empty for a job that runs as it should,
/// has all its units committed, or is unknown. Linear in the jobs and in the leases of the job. Codes:
/// paused, memory, no_worker, worker_unavailable, slots_busy, turn, max_leases, frames_in_flight, backoff,
/// quarantine, worker_set_aside, second_opinion, overdue, no_progress, audit, frames_kept, filtering.
std::vector<Reason> Explain(const State& state, const job::JobId& job, absl::Time now);

}  // namespace lumifold::scheduler
