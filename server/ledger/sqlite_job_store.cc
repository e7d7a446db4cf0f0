#include "server/ledger/sqlite_job_store.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "server/ledger/sql_job_store.h"
#include "server/ledger/sql_schema.h"
#include "server/ledger/sqlite_connection.h"

namespace lumifold::ledger {

absl::StatusOr<std::unique_ptr<JobStore>> OpenSqliteJobStore(const std::string& path) {
  absl::StatusOr<std::unique_ptr<SqliteConnection>> writer = SqliteConnection::Open(path);
  if (!writer.ok()) return writer.status();
  if (absl::Status status = PrepareSchema(**writer); !status.ok())
    return absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
  absl::StatusOr<std::unique_ptr<SqliteConnection>> reader = SqliteConnection::Open(path);
  if (!reader.ok()) return reader.status();
  return MakeSqlJobStore(*std::move(writer), *std::move(reader));
}

}  // namespace lumifold::ledger
