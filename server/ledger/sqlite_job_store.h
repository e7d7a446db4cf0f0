#pragma once

#include <memory>
#include <string>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

/// Opens or creates the ledger in the SQLite file `path`. Write-ahead log, synchronous=FULL: a commit that
/// has returned is on the disk. Other processes may read the file at the same time.
/// Errors: kUnavailable and kDataLoss naming the file; kFailedPrecondition where a later version of Lumifold
/// wrote it.
absl::StatusOr<std::unique_ptr<JobStore>> OpenSqliteJobStore(const std::string& path);

}  // namespace lumifold::ledger
