#pragma once

#include "lumifold/v1/job.pb.h"
#include "server/ledger/job_store.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::server {

/// What clients are told of a job that has ended, by its row in the ledger.
v1::JobStatus StatusOfEndedJob(const ledger::JobRecord& record);

/// What clients are told of an active job: the row for what the scheduler does not know.
v1::JobStatus StatusOfActiveJob(const ledger::JobRecord& record, const scheduler::JobProgress& progress);

/// True for DONE, FAILED and CANCELLED.
bool HasEnded(v1::JobState state);

}  // namespace lumifold::server
