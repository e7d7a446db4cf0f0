#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

struct sqlite3;
struct sqlite3_stmt;

namespace lumifold::ledger {

/// A prepared statement on its way through its rows. Parameters are bound and columns read in order, from the
/// first. A step that fails makes every later one fail alike; status() tells.
class SqliteStatement {
 public:
  SqliteStatement(sqlite3* db, const std::string& sql);

  SqliteStatement& Bind(int64_t value);
  SqliteStatement& Bind(double value);
  SqliteStatement& Bind(const std::string& text);
  SqliteStatement& BindBlob(const std::string& bytes);

  /// Steps to the next row; false at the end and on errors.
  bool Next();
  /// Runs a statement that gives no rows.
  absl::Status Run();
  /// Makes it ready to be bound and run again.
  void Reset();

  int64_t Int();
  double Real();
  std::string Text();

  absl::Status status() const { return status_; }
  /// Rows the last INSERT, UPDATE or DELETE changed.
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

/// An open SQLite database. Threads: one at a time.
class SqliteConnection {
 public:
  /// Opens `path`, made where it is missing. Errors: kUnavailable naming the path.
  static absl::StatusOr<SqliteConnection> Open(const std::string& path);

  SqliteStatement Prepare(const std::string& sql) { return {db_.get(), sql}; }
  /// Runs statements that give no rows and take no parameters.
  absl::Status Execute(const std::string& sql);
  /// Ends a transaction: commits it if `outcome` is OK, else takes it back. Gives the first error.
  absl::Status EndTransaction(const absl::Status& outcome);

 private:
  struct Close {
    void operator()(sqlite3* db) const;
  };
  explicit SqliteConnection(sqlite3* db) : db_(db) {}

  std::unique_ptr<sqlite3, Close> db_;
};

}  // namespace lumifold::ledger
