#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

struct sqlite3;
struct sqlite3_stmt;

namespace lumifold::ledger {

/// A prepared statement and its position in its rows. Parameters are bound and columns are read in order,
/// from the first. After a failed step every later step fails with the same status().
class SqliteStatement {
 public:
  SqliteStatement(sqlite3* db, const std::string& sql);

  SqliteStatement& Bind(int64_t value);
  SqliteStatement& Bind(double value);
  SqliteStatement& Bind(const std::string& text);
  SqliteStatement& BindBlob(const std::string& bytes);

  /// Steps to the next row; false at the end and on errors.
  bool Next();
  /// Runs a statement that returns no rows.
  absl::Status Run();
  /// Resets the statement, to bind and run it again.
  void Reset();

  int64_t Int();
  double Real();
  std::string Text();

  absl::Status status() const { return status_; }
  /// Number of rows changed by the last INSERT, UPDATE or DELETE.
  int64_t ChangedRows() const;

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  void Check(int code);

  sqlite3* db_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  absl::Status status_;
  int next_parameter_ = 1;
  int next_column_ = 0;
};

/// An open SQLite database.
/// Threads: one at a time.
class SqliteConnection {
 public:
  /// Opens or creates `path`.
  /// Errors: kUnavailable naming the path.
  static absl::StatusOr<SqliteConnection> Open(const std::string& path);

  SqliteStatement Prepare(const std::string& sql) { return {db_.get(), sql}; }
  /// Runs statements without result rows and parameters.
  absl::Status Execute(const std::string& sql);
  /// Ends a transaction: commits it if `outcome` is OK, otherwise rolls it back. Returns the first error.
  absl::Status EndTransaction(const absl::Status& outcome);

 private:
  struct Close {
    void operator()(sqlite3* db) const;
  };
  explicit SqliteConnection(sqlite3* db) : db_(db) {}

  std::unique_ptr<sqlite3, Close> db_;
};

}  // namespace lumifold::ledger
