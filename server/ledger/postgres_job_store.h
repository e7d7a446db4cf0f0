#pragma once

#include <memory>
#include <string>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

/// Opens the ledger in a PostgreSQL database, in which its tables are created if they are missing. `conninfo`
/// is a URI or a list of keywords, as libpq takes them. A call that finds the server gone returns
/// kUnavailable; later calls connect again. A call takes no longer than about a minute, whatever the server
/// does.
/// Errors: kInvalidArgument for a string that libpq cannot parse; kUnavailable naming host, port and
/// database; kFailedPrecondition where a later version of Lumifold wrote the tables. No error has the
/// password.
absl::StatusOr<std::unique_ptr<JobStore>> OpenPostgresJobStore(const std::string& conninfo);

}  // namespace lumifold::ledger
