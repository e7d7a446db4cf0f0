#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "server/ledger/job_store.h"
#include "server/ledger/sql_connection.h"

namespace lumifold::ledger {

/// JobStore::CommitUnits within a transaction. All statements of one kind are one batch, so that the number
/// of round trips to a database server does not depend on the number of jobs and units.
absl::StatusOr<std::vector<absl::Status>> CommitJobs(SqlConnection& db, absl::Span<const JobCommit> commits);

/// Counts the units of a frame that are in no unit log, for JobStore::RecordKeptFrame; `job` is the number of
/// the job's row.
absl::Status CountKept(SqlConnection& db, int64_t job, const JobCommit& commit);

}  // namespace lumifold::ledger
