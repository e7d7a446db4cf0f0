#pragma once

#include <memory>
#include <string>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

/// Environment variable that names the store where no flag does, and for child processes: their arguments are
/// visible to all users of the machine, and the name of a store may have a password.
inline constexpr char kStoreVariable[] = "LUMIFOLD_STORE";

/// The name of the store in the data folder.
inline constexpr char kSqliteStore[] = "sqlite";

/// Opens the store of a name: empty or "sqlite" for the SQLite file `sqlite_path`, or a URI
/// "postgresql://...".
/// Errors: kInvalidArgument for any other name, which is not shown; those of the store.
absl::StatusOr<std::unique_ptr<JobStore>> OpenJobStore(const std::string& name,
                                                       const std::string& sqlite_path);

}  // namespace lumifold::ledger
