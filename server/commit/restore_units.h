#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// What a data folder has of the unfinished frames of a job.
struct RestoredUnits {
  /// Frames that have a log or committed units.
  std::set<int32_t> frames;
  /// End of the committed records in each of the logs that `folder` writes.
  std::map<int32_t, uint64_t> committed_bytes;
  /// Units whose records were in the logs but not in the ledger. They are committed now.
  int64_t recovered = 0;
};

/// Visits the committed units of a job's frames without a result, after it has committed what the unit logs
/// have beyond the ledger: a coordinator that was killed between a sync and its commit, or a ledger that was
/// rebuilt, leaves such records. A unit whose record is damaged is left out. `record` and `finished`, the
/// frames with a result, are those of the ledger. `now` is when what they have cost counts, by
/// the clock on the wall; nullopt: it does not count.
/// Errors: those of the ledger; kUnavailable naming the log; kFailedPrecondition where another version wrote
/// it.
absl::StatusOr<RestoredUnits> RestoreUnits(const DataFolder& folder, ledger::JobStore& store,
                                           const ledger::OwnedJob& job, const ledger::JobRecord& record,
                                           const std::vector<int32_t>& finished,
                                           std::optional<absl::Time> now,
                                           absl::FunctionRef<void(const ledger::UnitRecord&)> visit);

}  // namespace lumifold::server
