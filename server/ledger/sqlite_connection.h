#pragma once

#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "server/ledger/sql_connection.h"

struct sqlite3;
struct sqlite3_stmt;

namespace lumifold::ledger {

/// An open SQLite database. Statements are prepared once.
class SqliteConnection final : public SqlConnection {
 public:
  /// Opens or creates `path`: write-ahead log, synchronous=FULL.
  /// Errors: those of SqlConnection, naming the path.
  static absl::StatusOr<std::unique_ptr<SqliteConnection>> Open(const std::string& path);

  const SqlDialect& dialect() const override;
  absl::Status RunScript(const std::string& sql) override;
  absl::StatusOr<int64_t> SchemaVersion() override;
  absl::Status SetSchemaVersion(int64_t version) override;

 private:
  struct Close {
    void operator()(sqlite3* db) const;
  };
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  struct Statement {
    std::unique_ptr<sqlite3_stmt, Finalize> handle;
    /// SQLite's number of the parameters $1, $2, ...
    std::vector<int> parameters;
  };

  explicit SqliteConnection(sqlite3* db) : db_(db) {}
  absl::Status RunChecked(const std::string& sql, absl::Span<const SqlParams> batch, Visit visit) override;
  absl::Status StatusOf(int code) const;
  absl::StatusOr<Statement*> Prepare(const std::string& sql);
  absl::Status Bind(const Statement& statement, const SqlParams& params);

  std::unique_ptr<sqlite3, Close> db_;
  std::unordered_map<std::string, Statement> statements_;  // by SQL; closed before db_
};

}  // namespace lumifold::ledger
