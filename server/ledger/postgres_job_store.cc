#include "server/ledger/postgres_job_store.h"

#include <utility>

#include "server/ledger/postgres_connection.h"
#include "server/ledger/sql_job_store.h"
#include "server/ledger/sql_schema.h"

namespace lumifold::ledger {

absl::StatusOr<std::unique_ptr<JobStore>> OpenPostgresJobStore(const std::string& conninfo) {
  absl::StatusOr<std::unique_ptr<PostgresConnection>> writer = PostgresConnection::Open(conninfo);
  if (!writer.ok()) return writer.status();
  if (absl::Status status = PrepareSchema(**writer); !status.ok()) return status;
  absl::StatusOr<std::unique_ptr<PostgresConnection>> reader = PostgresConnection::Open(conninfo);
  if (!reader.ok()) return reader.status();
  return MakeSqlJobStore(*std::move(writer), *std::move(reader));
}

}  // namespace lumifold::ledger
