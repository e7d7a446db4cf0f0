#pragma once

#include "absl/status/status.h"
#include "server/ledger/sql_connection.h"

namespace lumifold::ledger {

/// Creates the tables of the ledger in an empty database, or changes those of an earlier schema into them.
/// Errors: kFailedPrecondition for a later schema; those of the connection.
absl::Status PrepareSchema(SqlConnection& db);

}  // namespace lumifold::ledger
