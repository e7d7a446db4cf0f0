#include "server/ledger/postgres_connection.h"

#include <libpq-fe.h>

#include <array>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "proto/retry/storage_away.h"

namespace lumifold::ledger {
namespace {

/// Numbers of the types in PostgreSQL's catalogue, which never change.
constexpr Oid kBytea = 17;
constexpr Oid kInt8 = 20;
constexpr Oid kText = 25;
constexpr Oid kFloat8 = 701;
constexpr int kBinary = 1;

/// Statements of a pipeline between two synchronisations: bounds what both ends buffer.
constexpr size_t kMaxPipeline = 1024;

/// Of the advisory lock under which the schema is prepared; any fixed number.
constexpr char kLockSchema[] = "SELECT pg_advisory_xact_lock(5497234901)";

constexpr SqlDialect kDialect = {
    .begin = "BEGIN",
    .for_update = " FOR UPDATE",
    .blob = "BYTEA",
    .serial = "BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY",
    .clustered = "",
};

/// For each connection. A server that stops answering is given up, and so is a coordinator that is stopped or
/// cut off within a transaction: its locks, which would keep its successor out, are gone about when it is
/// taken for dead. The server finds out by keepalives that the rest of a pipeline will not come. An
/// acknowledged commit is on its disk.
constexpr char kSettings[] = R"(
SET statement_timeout = '60s';
SET lock_timeout = '20s';
SET idle_in_transaction_session_timeout = '2s';
SET tcp_keepalives_idle = 1;
SET tcp_keepalives_interval = 1;
SET tcp_keepalives_count = 2;
SET default_transaction_isolation = 'read committed';
SELECT set_config('synchronous_commit', 'on', false) WHERE current_setting('synchronous_commit') = 'off';
)";

struct ClearResult {
  void operator()(PGresult* result) const { PQclear(result); }
};
using Result = std::unique_ptr<PGresult, ClearResult>;

template <typename T>
std::string BigEndian(T value) {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), &value, sizeof(T));
  return {bytes.rbegin(), bytes.rend()};
}
static_assert(std::endian::native == std::endian::little);

class PostgresRow final : public SqlRow {
 public:
  PostgresRow(const PGresult* result, int row) : result_(result), row_(row) {}

 private:
  /// The bytes of a value of this type.
  std::optional<std::string> Value(int column, Oid type) const {
    if (PQftype(result_, column) != type || PQgetisnull(result_, row_, column) != 0) return std::nullopt;
    return std::string(PQgetvalue(result_, row_, column),
                       static_cast<size_t>(PQgetlength(result_, row_, column)));
  }
  template <typename T>
  std::optional<T> Number(int column, Oid type) const {
    const std::optional<std::string> bytes = Value(column, type);
    if (!bytes.has_value() || bytes->size() != sizeof(T)) return std::nullopt;
    const std::string reversed(bytes->rbegin(), bytes->rend());
    T value;
    std::memcpy(&value, reversed.data(), sizeof(T));
    return value;
  }
  std::optional<int64_t> ReadInt(int column) override { return Number<int64_t>(column, kInt8); }
  std::optional<double> ReadReal(int column) override { return Number<double>(column, kFloat8); }
  std::optional<std::string> ReadText(int column) override { return Value(column, kText); }
  std::optional<std::string> ReadBytes(int column) override { return Value(column, kBytea); }

  const PGresult* result_;
  int row_;
};

struct TypeOf {
  Oid operator()(int64_t) const { return kInt8; }
  Oid operator()(double) const { return kFloat8; }
  Oid operator()(std::string_view) const { return kText; }
  Oid operator()(SqlBytes) const { return kBytea; }
};

struct BytesOf {
  std::string operator()(int64_t value) const { return BigEndian(value); }
  std::string operator()(double value) const { return BigEndian(value); }
  std::string operator()(std::string_view text) const { return std::string(text); }
  std::string operator()(SqlBytes value) const { return std::string(value.bytes); }
};

absl::StatusCode CodeOf(std::string_view sqlstate) {
  if (sqlstate.empty()) return absl::StatusCode::kUnavailable;  // the connection is lost
  if (sqlstate == "23505") return absl::StatusCode::kAlreadyExists;
  if (sqlstate == "XX001" || sqlstate == "XX002") return absl::StatusCode::kDataLoss;
  if (sqlstate == "22021") return absl::StatusCode::kInvalidArgument;  // text that is not UTF-8
  // Connection, login, rolled back for another transaction, resources, locks, shutdown, input and output,
  // read-only.
  for (const std::string_view group : {"08", "28", "40", "53", "55", "57", "58", "25006"}) {
    if (sqlstate.starts_with(group)) return absl::StatusCode::kUnavailable;
  }
  return absl::StatusCode::kInternal;
}

}  // namespace

void PostgresConnection::Close::operator()(pg_conn* connection) const { PQfinish(connection); }

PostgresConnection::PostgresConnection(std::string conninfo, Address address)
    : conninfo_(std::move(conninfo)), address_(std::move(address)) {}

absl::StatusOr<PostgresConnection::Address> PostgresConnection::AddressOf(const std::string& conninfo) {
  char* error = nullptr;
  PQconninfoOption* const options = PQconninfoParse(conninfo.c_str(), &error);
  // libpq's message may quote the string, password and all.
  PQfreemem(error);
  if (options == nullptr)
    return absl::InvalidArgumentError(
        "store: libpq cannot parse the connection string (not shown: it may have a password)");
  const absl::Cleanup free = [options] { PQconninfoFree(options); };
  Address address;
  std::string host;
  std::string port;
  std::string database;
  for (const PQconninfoOption* option = options; option->keyword != nullptr; ++option) {
    const std::string_view keyword = option->keyword;
    const std::string value = option->val == nullptr ? "" : option->val;
    if (keyword == "password") address.password = value;
    if (keyword == "host") host = value;
    if (keyword == "port") port = value;
    if (keyword == "dbname") database = value;
  }
  address.name = absl::StrCat("postgresql://", host, port.empty() ? "" : ":", port, "/", database);
  return address;
}

absl::StatusOr<std::unique_ptr<PostgresConnection>> PostgresConnection::Open(const std::string& conninfo) {
  absl::StatusOr<Address> address = AddressOf(conninfo);
  if (!address.ok()) return address.status();
  std::unique_ptr<PostgresConnection> connection(new PostgresConnection(conninfo, *std::move(address)));
  if (absl::Status status = connection->Connect(); !status.ok()) return status;
  return connection;
}

const SqlDialect& PostgresConnection::dialect() const { return kDialect; }

absl::Status PostgresConnection::Error(const char* sqlstate, const std::string& message) const {
  std::string text(absl::StripAsciiWhitespace(message));
  if (!address_.password.empty()) text = absl::StrReplaceAll(text, {{address_.password, "***"}});
  const absl::Status error(
      CodeOf(sqlstate == nullptr ? "" : sqlstate),
      absl::StrCat("ledger: ", address_.name, ": ", absl::StrReplaceAll(text, {{"\n", "; "}})));
  if (!absl::IsUnavailable(error)) return error;
  return retry::MarkStorageAway(
      error, sqlstate == nullptr ? "the database does not answer" : "the database cannot do its work");
}

absl::Status PostgresConnection::ConnectionError() {
  is_broken_ = true;
  return Error(nullptr,
               connection_ == nullptr ? "the connection is lost" : PQerrorMessage(connection_.get()));
}

bool PostgresConnection::IsLost() const {
  return connection_ == nullptr || is_broken_ || PQstatus(connection_.get()) != CONNECTION_OK;
}

absl::Status PostgresConnection::Connect() {
  if (!IsLost()) return absl::OkStatus();
  if (in_transaction()) return ConnectionError();
  prepared_.clear();
  is_broken_ = false;
  // Before dbname, which is expanded: what the user states. After it: what we need.
  const std::array<const char*, 9> keywords = {"fallback_application_name",
                                               "connect_timeout",
                                               "keepalives_idle",
                                               "keepalives_interval",
                                               "keepalives_count",
                                               "tcp_user_timeout",
                                               "dbname",
                                               "client_encoding",
                                               nullptr};
  const std::array<const char*, 9> values = {"lumifold",        "5",    "10",   "5", "3", "20000",
                                             conninfo_.c_str(), "UTF8", nullptr};
  connection_.reset(PQconnectdbParams(keywords.data(), values.data(), /*expand_dbname=*/1));
  if (IsLost()) return ConnectionError();
  PQsetNoticeProcessor(connection_.get(), [](void*, const char*) {}, nullptr);
  const Result result(PQexec(connection_.get(), kSettings));
  return StatusOf(result.get());
}

absl::Status PostgresConnection::StatusOf(const pg_result* result) {
  if (result == nullptr) return ConnectionError();
  switch (PQresultStatus(result)) {
    case PGRES_COMMAND_OK:
    case PGRES_TUPLES_OK:
    case PGRES_SINGLE_TUPLE:
    case PGRES_EMPTY_QUERY:
    case PGRES_PIPELINE_SYNC:
      return absl::OkStatus();
    case PGRES_PIPELINE_ABORTED:
      return absl::AbortedError("ledger: an earlier statement of the batch failed");
    default:
      break;
  }
  // Errors of libpq itself have no state; a server that ends the connection says so with the severity.
  const char* const sqlstate = PQresultErrorField(result, PG_DIAG_SQLSTATE);
  const char* const severity = PQresultErrorField(result, PG_DIAG_SEVERITY_NONLOCALIZED);
  const std::string_view grade = severity == nullptr ? "" : severity;
  is_broken_ |= sqlstate == nullptr || grade == "FATAL" || grade == "PANIC";
  return Error(sqlstate, PQresultErrorMessage(result));
}

absl::StatusOr<std::string> PostgresConnection::Prepare(const std::string& sql, const SqlParams& params) {
  const auto found = prepared_.find(sql);
  if (found != prepared_.end()) return found->second;
  std::vector<Oid> types;
  for (const SqlValue& value : params) types.push_back(std::visit(TypeOf{}, value));
  std::string name = absl::StrCat("s", prepared_.size());
  const Result result(
      PQprepare(connection_.get(), name.c_str(), sql.c_str(), static_cast<int>(types.size()), types.data()));
  if (absl::Status status = StatusOf(result.get()); !status.ok()) return status;
  return prepared_.emplace(sql, std::move(name)).first->second;
}

absl::Status PostgresConnection::Send(const std::string& name, const SqlParams& params) {
  std::vector<std::string> bytes;
  std::vector<const char*> values;
  std::vector<int> lengths;
  for (const SqlValue& value : params) bytes.push_back(std::visit(BytesOf{}, value));
  for (const std::string& value : bytes) {
    values.push_back(value.data());
    lengths.push_back(static_cast<int>(value.size()));
  }
  const std::vector<int> formats(params.size(), kBinary);
  const int sent = PQsendQueryPrepared(connection_.get(), name.c_str(), static_cast<int>(params.size()),
                                       values.data(), lengths.data(), formats.data(), kBinary);
  return sent == 1 ? absl::OkStatus() : ConnectionError();
}

absl::Status PostgresConnection::Receive(size_t index, Visit visit) {
  absl::Status status;
  // All results are taken, also after an error: the connection is then free for the next statement.
  while (const Result result{PQgetResult(connection_.get())}) {
    if (status.ok()) status = StatusOf(result.get());
    for (int row = 0; status.ok() && row < PQntuples(result.get()); ++row) {
      PostgresRow reader(result.get(), row);
      visit(index, reader);
    }
  }
  if (status.ok() && IsLost()) status = ConnectionError();
  return status;
}

absl::Status PostgresConnection::RunOne(const std::string& name, const SqlParams& params, Visit visit) {
  if (absl::Status status = Send(name, params); !status.ok()) return status;
  PQsetSingleRowMode(connection_.get());  // a result of a million rows is not held in memory
  return Receive(0, visit);
}

absl::Status PostgresConnection::RunPipeline(const std::string& name, absl::Span<const SqlParams> batch,
                                             size_t first, Visit visit) {
  if (PQenterPipelineMode(connection_.get()) != 1) return ConnectionError();
  absl::Status status;
  for (const SqlParams& params : batch) {
    if (status.ok()) status = Send(name, params);
  }
  if (status.ok() && PQpipelineSync(connection_.get()) != 1) status = ConnectionError();
  if (!status.ok()) {  // no end of the pipeline was sent, so none will be received
    connection_.reset();
    return status;
  }
  for (size_t i = 0; status.ok() && i < batch.size(); ++i) status = Receive(first + i, visit);
  // After an error the server skips the rest of the pipeline; its results are taken up to the
  // synchronisation.
  bool is_synchronised = false;
  while (!is_synchronised && !IsLost()) {
    const Result result(PQgetResult(connection_.get()));
    is_synchronised = result != nullptr && PQresultStatus(result.get()) == PGRES_PIPELINE_SYNC;
  }
  if (PQexitPipelineMode(connection_.get()) != 1 && status.ok()) status = ConnectionError();
  // A pipeline that is not at its end is of no use any more.
  if (!is_synchronised) connection_.reset();
  return status;
}

absl::Status PostgresConnection::RunChecked(const std::string& sql, absl::Span<const SqlParams> batch,
                                            Visit visit) {
  bool is_answered = false;
  const auto run = [&]() -> absl::Status {
    if (absl::Status status = Connect(); !status.ok()) return status;
    const absl::StatusOr<std::string> name = Prepare(sql, batch.front());
    if (!name.ok()) return name.status();
    const auto visit_answer = [&](size_t index, SqlRow& row) {
      is_answered = true;
      visit(index, row);
    };
    if (batch.size() == 1) return RunOne(*name, batch.front(), visit_answer);
    absl::Status status;
    for (size_t first = 0; status.ok() && first < batch.size(); first += kMaxPipeline)
      status = RunPipeline(*name, batch.subspan(first, kMaxPipeline), first, visit_answer);
    return status;
  };
  const absl::Status status = run();
  // A server that was restarted ends idle connections. Outside of transactions we run only what can be
  // repeated.
  const bool can_repeat = absl::IsUnavailable(status) && IsLost() && !in_transaction() && !is_answered;
  return can_repeat ? run() : status;
}

absl::Status PostgresConnection::RunScript(const std::string& sql) {
  const auto run = [&]() -> absl::Status {
    if (absl::Status status = Connect(); !status.ok()) return status;
    const Result result(PQexec(connection_.get(), sql.c_str()));
    return StatusOf(result.get());
  };
  const absl::Status status = run();
  return !status.ok() && IsLost() && !in_transaction() ? run() : status;
}

absl::StatusOr<int64_t> PostgresConnection::SchemaVersion() {
  if (in_transaction()) {
    if (absl::Status status = Run(kLockSchema, {}); !status.ok()) return status;
  }
  const absl::StatusOr<std::optional<int64_t>> exists =
      // Not to_regclass: in this transaction it may not see a table that another one has just committed.
      QueryInt(
          "SELECT COUNT(*) FROM information_schema.tables WHERE table_schema = current_schema()"
          " AND table_name = 'ledger_schema'",
          {});
  if (!exists.ok()) return exists.status();
  if (exists->value_or(0) == 0) return 0;
  const absl::StatusOr<std::optional<int64_t>> version = QueryInt("SELECT version FROM ledger_schema", {});
  if (!version.ok()) return version.status();
  return version->value_or(0);
}

absl::Status PostgresConnection::SetSchemaVersion(int64_t version) {
  return RunScript(absl::StrCat(
      "CREATE TABLE IF NOT EXISTS ledger_schema(version BIGINT NOT NULL); DELETE FROM ledger_schema;"
      " INSERT INTO ledger_schema(version) VALUES(",
      version, ")"));
}

}  // namespace lumifold::ledger
