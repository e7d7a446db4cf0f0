#include "tests/unit/ledger/postgres_database.h"

#include <gtest/gtest.h>

#include <atomic>

#include "absl/strings/str_cat.h"
#include "server/ledger/postgres_connection.h"
#include "server/ledger/postgres_job_store.h"

namespace lumifold::ledger {

PrivatePostgres* PostgresServer(std::string* why_not) {
  static std::string reason;
  static const std::unique_ptr<PrivatePostgres> server = PrivatePostgres::Start(&reason);
  *why_not = reason;
  return server.get();
}

PostgresDatabase::PostgresDatabase(const std::string& uri) {
  static std::atomic<int> count = 0;
  const std::string schema = absl::StrCat("test_", ++count);
  EXPECT_TRUE((*PostgresConnection::Open(uri))->RunScript("CREATE SCHEMA " + schema).ok());
  uri_ = absl::StrCat(uri, "&options=-csearch_path%3D", schema);
}

absl::StatusOr<std::unique_ptr<JobStore>> PostgresDatabase::Open() { return OpenPostgresJobStore(uri_); }

}  // namespace lumifold::ledger
