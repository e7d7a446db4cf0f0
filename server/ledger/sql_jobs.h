#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/ledger/job_store.h"
#include "server/ledger/sql_connection.h"

namespace lumifold::ledger {

/// A spec as stored: without the dependencies of its scene, and a JobSpec that has only them. The spec is
/// what both parse to, one after the other.
struct SpecBytes {
  std::string spec;
  std::string files;
};
SpecBytes BytesOfSpec(const v1::JobSpec& spec);

/// XXH3-128 of a request, to tell a repeated request from another one with the same id.
std::string RequestDigest(const v1::JobSpec& spec, const v1::Scheduling& scheduling);

/// A row of jobs.
struct JobRow {
  int64_t number = 0;
  JobRecord record;
  /// kInternal if the row is damaged: then only number and record.id count.
  absl::Status damage;
};

/// Runs "SELECT ... FROM jobs" with the columns of a JobRow and `condition`, with or without the files of the
/// specs.
absl::StatusOr<std::vector<JobRow>> QueryJobs(SqlConnection& db, bool with_files,
                                              const std::string& condition, const SqlParams& params);

/// jobs.estimated_error of a job without one.
inline constexpr double kNoError = -1;

/// Reads the warnings of each job that is not damaged, in order.
absl::Status AddWarnings(SqlConnection& db, std::vector<JobRow>* jobs);

/// A page of jobs.
absl::StatusOr<JobPage> QueryPage(SqlConnection& db, const JobFilter& filter);

/// The job's state and owner. In a transaction nobody else may change the job before its end.
struct LockedJob {
  /// OK; kNotFound; kInternal for a damaged row.
  absl::Status status;
  int64_t number = 0;
  Epoch epoch;
  bool has_ended = false;
};
absl::StatusOr<std::vector<LockedJob>> LockJobs(SqlConnection& db, const std::vector<job::JobId>& jobs);

/// Why the caller may not write to the job: kNotFound, kInternal, kAborted, kFailedPrecondition.
absl::Status CheckOwned(const OwnedJob& job, const LockedJob& row);

}  // namespace lumifold::ledger
