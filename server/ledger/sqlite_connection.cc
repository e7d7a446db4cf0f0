#include "server/ledger/sqlite_connection.h"

#include <sqlite3.h>

#include "absl/strings/str_cat.h"

namespace lumifold::ledger {
namespace {

constexpr int kBusyTimeoutMs = 10'000;

absl::Status StatusOf(sqlite3* db, int code) {
  if (code == SQLITE_OK || code == SQLITE_ROW || code == SQLITE_DONE) return absl::OkStatus();
  const std::string text = absl::StrCat("ledger: ", sqlite3_errmsg(db));
  return code == SQLITE_CONSTRAINT ? absl::AlreadyExistsError(text) : absl::UnavailableError(text);
}

}  // namespace

void SqliteStatement::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }

SqliteStatement::SqliteStatement(sqlite3* db, const std::string& sql) : db_(db) {
  sqlite3_stmt* statement = nullptr;
  Check(sqlite3_prepare_v2(db, sql.c_str(), static_cast<int>(sql.size()), &statement, nullptr));
  statement_.reset(statement);
}

void SqliteStatement::Check(int code) {
  if (status_.ok()) status_ = StatusOf(db_, code);
}

SqliteStatement& SqliteStatement::Bind(int64_t value) {
  if (status_.ok()) Check(sqlite3_bind_int64(statement_.get(), next_parameter_++, value));
  return *this;
}

SqliteStatement& SqliteStatement::Bind(double value) {
  if (status_.ok()) Check(sqlite3_bind_double(statement_.get(), next_parameter_++, value));
  return *this;
}

SqliteStatement& SqliteStatement::Bind(const std::string& text) {
  if (status_.ok()) {
    Check(sqlite3_bind_text64(statement_.get(), next_parameter_++, text.data(), text.size(), SQLITE_TRANSIENT,
                              SQLITE_UTF8));
  }
  return *this;
}

SqliteStatement& SqliteStatement::BindBlob(const std::string& bytes) {
  if (status_.ok()) {
    Check(sqlite3_bind_blob64(statement_.get(), next_parameter_++, bytes.data(), bytes.size(),
                              SQLITE_TRANSIENT));
  }
  return *this;
}

bool SqliteStatement::Next() {
  if (!status_.ok()) return false;
  next_column_ = 0;
  const int code = sqlite3_step(statement_.get());
  Check(code);
  return code == SQLITE_ROW;
}

absl::Status SqliteStatement::Run() {
  while (Next()) {
  }
  return status_;
}

void SqliteStatement::Reset() {
  sqlite3_reset(statement_.get());
  next_parameter_ = 1;
}

int64_t SqliteStatement::Int() { return sqlite3_column_int64(statement_.get(), next_column_++); }

double SqliteStatement::Real() { return sqlite3_column_double(statement_.get(), next_column_++); }

std::string SqliteStatement::Text() {
  const int column = next_column_++;
  const void* bytes = sqlite3_column_blob(statement_.get(), column);
  const int size = sqlite3_column_bytes(statement_.get(), column);
  return bytes == nullptr ? std::string()
                          : std::string(static_cast<const char*>(bytes), static_cast<size_t>(size));
}

int64_t SqliteStatement::ChangedRows() const { return sqlite3_changes(db_); }

void SqliteConnection::Close::operator()(sqlite3* db) const { sqlite3_close_v2(db); }

absl::StatusOr<SqliteConnection> SqliteConnection::Open(const std::string& path) {
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  SqliteConnection connection(db);
  if (code != SQLITE_OK) {
    return absl::UnavailableError(
        absl::StrCat(path, ": ", db == nullptr ? "out of memory" : sqlite3_errmsg(db)));
  }
  sqlite3_busy_timeout(db, kBusyTimeoutMs);
  return connection;
}

absl::Status SqliteConnection::Execute(const std::string& sql) {
  return StatusOf(db_.get(), sqlite3_exec(db_.get(), sql.c_str(), nullptr, nullptr, nullptr));
}

absl::Status SqliteConnection::EndTransaction(const absl::Status& outcome) {
  absl::Status status = outcome.ok() ? Execute("COMMIT") : outcome;
  // A failed COMMIT leaves the transaction open; after a failed ROLLBACK there is nothing to undo.
  if (!status.ok()) Execute("ROLLBACK").IgnoreError();
  return status;
}

}  // namespace lumifold::ledger
