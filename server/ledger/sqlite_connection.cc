#include "server/ledger/sqlite_connection.h"

#include <sqlite3.h>

#include <cstring>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "proto/retry/storage_away.h"

namespace lumifold::ledger {
namespace {

constexpr int kBusyTimeoutMs = 10'000;

constexpr SqlDialect kDialect = {
    // Takes the write lock at once: a transaction that took it later could find that what it has read has
    // changed.
    .begin = "BEGIN IMMEDIATE",
    .for_update = "",
    .blob = "BLOB",
    .serial = "INTEGER PRIMARY KEY AUTOINCREMENT",
    .clustered = "WITHOUT ROWID",
};

class SqliteRow final : public SqlRow {
 public:
  explicit SqliteRow(sqlite3_stmt* statement) : statement_(statement) {}

 private:
  bool Is(int column, int type) const { return sqlite3_column_type(statement_, column) == type; }
  std::string BytesOf(int column) const {
    const void* bytes = sqlite3_column_blob(statement_, column);
    const int size = sqlite3_column_bytes(statement_, column);
    return bytes == nullptr ? std::string()
                            : std::string(static_cast<const char*>(bytes), static_cast<size_t>(size));
  }
  std::optional<int64_t> ReadInt(int column) override {
    if (!Is(column, SQLITE_INTEGER)) return std::nullopt;
    return sqlite3_column_int64(statement_, column);
  }
  std::optional<double> ReadReal(int column) override {
    if (!Is(column, SQLITE_FLOAT)) return std::nullopt;
    return sqlite3_column_double(statement_, column);
  }
  std::optional<std::string> ReadText(int column) override {
    if (!Is(column, SQLITE_TEXT)) return std::nullopt;
    return BytesOf(column);
  }
  std::optional<std::string> ReadBytes(int column) override {
    if (!Is(column, SQLITE_BLOB)) return std::nullopt;
    return BytesOf(column);
  }

  sqlite3_stmt* statement_;
};

struct Binder {
  sqlite3_stmt* statement;
  int parameter;

  int operator()(int64_t value) const { return sqlite3_bind_int64(statement, parameter, value); }
  int operator()(double value) const { return sqlite3_bind_double(statement, parameter, value); }
  int operator()(std::string_view text) const {
    return sqlite3_bind_text64(statement, parameter, text.data() == nullptr ? "" : text.data(), text.size(),
                               SQLITE_STATIC, SQLITE_UTF8);
  }
  int operator()(SqlBytes value) const {
    // A null pointer would bind NULL.
    return sqlite3_bind_blob64(statement, parameter, value.bytes.data() == nullptr ? "" : value.bytes.data(),
                               value.bytes.size(), SQLITE_STATIC);
  }
};

}  // namespace

void SqliteConnection::Close::operator()(sqlite3* db) const { sqlite3_close_v2(db); }

void SqliteConnection::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }

absl::Status SqliteConnection::StatusOf(int code) const {
  if (code == SQLITE_OK || code == SQLITE_ROW || code == SQLITE_DONE) return absl::OkStatus();
  std::string text = absl::StrCat("ledger: ", sqlite3_errmsg(db_.get()));
  switch (code & 0xff) {  // the upper bits of an extended code say more of the same error
    case SQLITE_FULL:
    case SQLITE_IOERR:
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
    case SQLITE_NOMEM:
    case SQLITE_CANTOPEN:
    case SQLITE_READONLY:
    case SQLITE_PROTOCOL:
    case SQLITE_PERM:
    case SQLITE_INTERRUPT:
      if (const int cause = sqlite3_system_errno(db_.get()); cause != 0)
        absl::StrAppend(&text, " (", std::strerror(cause), ")");
      return retry::MarkStorageAway(absl::UnavailableError(text), text);
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(text);
    case SQLITE_CONSTRAINT:
      return absl::AlreadyExistsError(text);
    default:
      return absl::InternalError(text);
  }
}

absl::StatusOr<std::unique_ptr<SqliteConnection>> SqliteConnection::Open(const std::string& path) {
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  if (db == nullptr) return absl::UnavailableError(absl::StrCat(path, ": ledger: out of memory"));
  std::unique_ptr<SqliteConnection> connection(new SqliteConnection(db));
  absl::Status status = connection->StatusOf(code);
  if (status.ok()) {
    sqlite3_extended_result_codes(db, 1);
    sqlite3_busy_timeout(db, kBusyTimeoutMs);
    status =
        connection->RunScript("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON;");
  }
  if (!status.ok()) return absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
  return connection;
}

const SqlDialect& SqliteConnection::dialect() const { return kDialect; }

absl::StatusOr<SqliteConnection::Statement*> SqliteConnection::Prepare(const std::string& sql) {
  const auto found = statements_.find(sql);
  if (found != statements_.end()) return &found->second;
  sqlite3_stmt* handle = nullptr;
  const int code = sqlite3_prepare_v3(db_.get(), sql.c_str(), static_cast<int>(sql.size()),
                                      SQLITE_PREPARE_PERSISTENT, &handle, nullptr);
  Statement statement;
  statement.handle.reset(handle);
  if (absl::Status status = StatusOf(code); !status.ok()) return status;
  for (int i = 1; i <= sqlite3_bind_parameter_count(handle); ++i) {
    statement.parameters.push_back(sqlite3_bind_parameter_index(handle, absl::StrCat("$", i).c_str()));
  }
  return &statements_.emplace(sql, std::move(statement)).first->second;
}

absl::Status SqliteConnection::Bind(const Statement& statement, const SqlParams& params) {
  if (params.size() != statement.parameters.size())
    return absl::InternalError("ledger: wrong number of parameters");
  for (size_t i = 0; i < params.size(); ++i) {
    const int code = std::visit(Binder{statement.handle.get(), statement.parameters[i]}, params[i]);
    if (absl::Status status = StatusOf(code); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status SqliteConnection::RunChecked(const std::string& sql, absl::Span<const SqlParams> batch,
                                          Visit visit) {
  const absl::StatusOr<Statement*> statement = Prepare(sql);
  if (!statement.ok()) return statement.status();
  sqlite3_stmt* const handle = (*statement)->handle.get();
  // A statement that is not reset would keep its read lock.
  const absl::Cleanup reset = [handle] {
    sqlite3_reset(handle);
    sqlite3_clear_bindings(handle);
  };
  for (size_t i = 0; i < batch.size(); ++i) {
    if (absl::Status status = Bind(**statement, batch[i]); !status.ok()) return status;
    int code = sqlite3_step(handle);
    while (code == SQLITE_ROW) {
      SqliteRow row(handle);
      visit(i, row);
      code = sqlite3_step(handle);
    }
    if (absl::Status status = StatusOf(code); !status.ok()) return status;
    sqlite3_reset(handle);
  }
  return absl::OkStatus();
}

absl::Status SqliteConnection::RunScript(const std::string& sql) {
  return StatusOf(sqlite3_exec(db_.get(), sql.c_str(), nullptr, nullptr, nullptr));
}

absl::StatusOr<int64_t> SqliteConnection::SchemaVersion() {
  const absl::StatusOr<std::optional<int64_t>> version = QueryInt("PRAGMA user_version", {});
  if (!version.ok()) return version.status();
  return version->value_or(0);
}

absl::Status SqliteConnection::SetSchemaVersion(int64_t version) {
  return RunScript(absl::StrCat("PRAGMA user_version=", version));
}

}  // namespace lumifold::ledger
