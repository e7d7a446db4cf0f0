#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/job/ids.h"
#include "server/storage/data_folder.h"

/// What lies in a data folder: its films and results, and what a coordinator that was killed has left.
namespace lumifold::server {

/// Jobs that have a film, and jobs that have results, by id.
std::vector<job::JobId> JobsWithFilm(const DataFolder& folder);
std::vector<job::JobId> JobsWithResults(const DataFolder& folder);

struct UnitLogFile {
  int32_t frame = 0;
  /// Relative to the data folder, as recorded in the ledger.
  std::string name;
  uint64_t bytes = 0;
};
/// The unit logs of a job, or of one of its frames, of all coordinators, by name.
std::vector<UnitLogFile> UnitLogsOf(const DataFolder& folder, const job::JobId& job);
std::vector<UnitLogFile> UnitLogsOf(const DataFolder& folder, const job::JobId& job, int32_t frame);
/// Frames of a job that have a result, in ascending order.
std::vector<int32_t> ResultsOf(const DataFolder& folder, const job::JobId& job);

/// Removes incomplete files of a coordinator that was killed, in the films and results of all jobs or of
/// one. If it was not, its writing of them fails.
/// Errors: kUnavailable naming the file.
absl::Status RemoveLeftovers(const DataFolder& folder);
absl::Status RemoveLeftoversOf(const DataFolder& folder, const job::JobId& job);

}  // namespace lumifold::server
