#pragma once

#include <memory>
#include <string>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

/// Opens the ledger in the SQLite file `path`, made where it is missing. Write-ahead log, synchronous=FULL: a
/// commit that returned is on the disk. Other processes may read it meanwhile.
/// Errors: kUnavailable naming the file; kFailedPrecondition where a newer version of Lumifold wrote it.
absl::StatusOr<std::unique_ptr<JobStore>> OpenSqliteJobStore(const std::string& path);

}  // namespace lumifold::ledger
