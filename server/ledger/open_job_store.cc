#include "server/ledger/open_job_store.h"

#include "server/ledger/postgres_job_store.h"
#include "server/ledger/sqlite_job_store.h"

namespace lumifold::ledger {

absl::StatusOr<std::unique_ptr<JobStore>> OpenJobStore(const std::string& name,
                                                       const std::string& sqlite_path) {
  if (name.empty() || name == kSqliteStore) return OpenSqliteJobStore(sqlite_path);
  if (name.starts_with("postgresql://") || name.starts_with("postgres://")) return OpenPostgresJobStore(name);
  return absl::InvalidArgumentError("store: neither \"sqlite\" nor a URI that begins with postgresql://");
}

}  // namespace lumifold::ledger
