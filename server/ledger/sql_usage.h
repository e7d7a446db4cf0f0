#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"
#include "server/ledger/job_store.h"
#include "server/ledger/sql_connection.h"

// What was spent on jobs, a row for each day and job. It is kept when the job is deleted.

namespace lumifold::ledger {

/// Work on one job, whose number this is, that is added to a day.
struct WorkOfDay {
  int64_t job = 0;
  int64_t day = 0;
  Work work;
};

/// Days since 1970, UTC.
int64_t DayOf(absl::Time time);
/// Within the transaction that commits the work.
absl::Status AddUsage(SqlConnection& db, const std::vector<WorkOfDay>& works);
/// The work of a finished frame; none where the report does not say when.
absl::Status AddFrameUsage(SqlConnection& db, int64_t job, const v1::FrameReport& report);
/// JobStore::Usage.
absl::StatusOr<std::vector<JobUsage>> QueryUsage(SqlConnection& db, const UsageFilter& filter);

}  // namespace lumifold::ledger
