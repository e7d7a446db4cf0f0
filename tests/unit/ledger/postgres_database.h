#pragma once

#include <memory>
#include <string>

#include "tests/support/private_postgres.h"
#include "tests/unit/ledger/job_store_fixture.h"

namespace lumifold::ledger {

/// The server of this program, which the first call starts; nullptr, with a message in `why_not`, where there
/// is none.
PrivatePostgres* PostgresServer(std::string* why_not);

/// A schema of its own in the server's database.
class PostgresDatabase final : public Database {
 public:
  explicit PostgresDatabase(const std::string& uri);
  absl::StatusOr<std::unique_ptr<JobStore>> Open() override;
  const std::string& uri() const { return uri_; }

 private:
  std::string uri_;
};

}  // namespace lumifold::ledger
