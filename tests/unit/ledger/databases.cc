#include "server/ledger/sqlite_job_store.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/ledger/job_store_fixture.h"
#include "tests/unit/ledger/memory_job_store.h"
#include "tests/unit/ledger/postgres_database.h"

namespace lumifold::ledger {
namespace {

class SqliteDatabase final : public Database {
 public:
  absl::StatusOr<std::unique_ptr<JobStore>> Open() override {
    return OpenSqliteJobStore(folder_.PathOf("ledger.db"));
  }

 private:
  TempFolder folder_;
};

class MemoryDatabase final : public Database {
 public:
  absl::StatusOr<std::unique_ptr<JobStore>> Open() override { return MakeMemoryJobStore(state_); }

 private:
  std::shared_ptr<MemoryState> state_ = MakeMemoryState();
};

std::unique_ptr<Database> MakePostgres(std::string* why_not) {
  const PrivatePostgres* server = PostgresServer(why_not);
  return server == nullptr ? nullptr : std::make_unique<PostgresDatabase>(server->uri());
}

}  // namespace

std::vector<DatabaseKind> DatabaseKinds() {
  return {{"Sqlite", [](std::string*) { return std::make_unique<SqliteDatabase>(); }},
          {"Model", [](std::string*) { return std::make_unique<MemoryDatabase>(); }},
          {"Postgres", MakePostgres}};
}

}  // namespace lumifold::ledger
