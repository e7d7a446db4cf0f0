#pragma once

#include <string>

#include "lumifold/v1/job.pb.h"
#include "server/ledger/job_store.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::server {

/// Status of a job that has ended, from its row in the ledger.
v1::JobStatus StatusOfEndedJob(const ledger::JobRecord& record);

/// Status of a job as its row tells it; of one that has not ended, which another coordinator may own, as far
/// as that goes.
v1::JobStatus StatusOfRecord(const ledger::JobRecord& record);

/// State of an active job as clients see it. `waits`: for other jobs.
v1::JobState StateOfActiveJob(const ledger::JobRecord& record, const scheduler::JobProgress& progress,
                              bool waits);

/// Status of an active job, from the scheduler and, for the other fields, from its row in the ledger.
v1::JobStatus StatusOfActiveJob(const ledger::JobRecord& record, const scheduler::JobProgress& progress,
                                bool waits);

/// Adds a warning of a unit to those of its job: each line once, at most job::kMaxJobWarnings; others are
/// counted.
void AddWarning(const std::string& line, ledger::JobRecord* record);

}  // namespace lumifold::server
