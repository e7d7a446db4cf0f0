#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "server/ledger/job_store.h"
#include "server/ledger/sql_connection.h"

// The statements of a JobStore, without locks and transactions. `job` is the number of a job's row. Those
// that write run within a transaction that has locked the job.

namespace lumifold::ledger {

absl::Status NoJob(const job::JobId& job);

/// JobStore::CreateJob.
absl::Status InsertJob(SqlConnection& db, const NewJob& job, job::JobId* id);
/// JobStore::FindRequest.
absl::StatusOr<std::optional<job::JobId>> QueryRequest(SqlConnection& db, const NewJob& job);
/// JobStore::ClaimUnfinishedJobs.
absl::Status ClaimJobs(SqlConnection& db, const Owner& owner, ClaimedJobs* claimed);
/// Makes a job active as in JobStore::ReopenFrames.
absl::Status ReopenJob(SqlConnection& db, int64_t job, const Owner& owner, const Reopening& reopening);
/// Removes all rows of a job; those of its units become garbage.
absl::Status RemoveJob(SqlConnection& db, int64_t job);

/// JobStore::ForEachUnit.
absl::Status VisitUnits(SqlConnection& db, const job::JobId& job, std::optional<int32_t> frame,
                        absl::FunctionRef<void(const UnitRecord&)> visit);
/// JobStore::RevokeUnits.
absl::Status DeleteUnits(SqlConnection& db, int64_t job, absl::Span<const job::UnitKey> units);
/// JobStore::RecordFrame.
absl::Status FinishFilm(SqlConnection& db, int64_t job, int32_t frame, const v1::FrameReport& report);
/// Removes the films of the job that meet a condition, in which $1 is the job; their units become garbage.
absl::Status DiscardFilms(SqlConnection& db, int64_t job, const std::string& condition,
                          const SqlParams& params);
/// JobStore::FinishedFrames.
absl::StatusOr<std::vector<int32_t>> QueryFinishedFrames(SqlConnection& db, const job::JobId& job);
/// JobStore::DeliverersOf.
absl::StatusOr<std::vector<std::string>> QueryDeliverers(SqlConnection& db, const job::JobId& job);
/// JobStore::PurgeUnits.
absl::StatusOr<int64_t> DeleteGarbage(SqlConnection& db, int64_t max_rows);
/// JobStore::BlockedWorkers.
absl::StatusOr<std::vector<BlockedWorker>> QueryBlockedWorkers(SqlConnection& db);

}  // namespace lumifold::ledger
