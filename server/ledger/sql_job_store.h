#pragma once

#include <memory>

#include "server/ledger/job_store.h"
#include "server/ledger/sql_connection.h"

namespace lumifold::ledger {

/// A JobStore in a database whose schema is prepared (PrepareSchema). Reads have a connection of their own,
/// so that they do not wait for writes.
std::unique_ptr<JobStore> MakeSqlJobStore(std::unique_ptr<SqlConnection> writer,
                                          std::unique_ptr<SqlConnection> reader);

}  // namespace lumifold::ledger
