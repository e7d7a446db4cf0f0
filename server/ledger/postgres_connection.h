#pragma once

#include <memory>
#include <string>
#include <unordered_map>

#include "server/ledger/sql_connection.h"

struct pg_conn;
struct pg_result;

namespace lumifold::ledger {

/// A connection to a PostgreSQL database. It is opened again when it is lost: the call that finds it lost
/// returns kUnavailable, unless nothing of the call can have happened. Statements are prepared once a
/// connection; a batch is one pipeline. No error has the password.
class PostgresConnection final : public SqlConnection {
 public:
  /// `conninfo` is a URI or a list of keywords, as libpq takes them.
  /// Errors: kInvalidArgument for what libpq cannot parse; kUnavailable naming host, port and database.
  static absl::StatusOr<std::unique_ptr<PostgresConnection>> Open(const std::string& conninfo);

  const SqlDialect& dialect() const override;
  absl::Status RunScript(const std::string& sql) override;
  absl::StatusOr<int64_t> SchemaVersion() override;
  absl::Status SetSchemaVersion(int64_t version) override;

 private:
  struct Close {
    void operator()(pg_conn* connection) const;
  };
  /// What is known of the other end.
  struct Address {
    std::string name;
    std::string password;
  };

  PostgresConnection(std::string conninfo, Address address);
  static absl::StatusOr<Address> AddressOf(const std::string& conninfo);
  absl::Status RunChecked(const std::string& sql, absl::Span<const SqlParams> batch, Visit visit) override;

  /// Opens the connection if it is not open, but not within a transaction, of which a part would be lost.
  absl::Status Connect();
  bool IsLost() const;
  absl::Status Error(const char* sqlstate, const std::string& message) const;
  /// The connection is lost: it is opened again for the next call.
  absl::Status ConnectionError();
  absl::Status StatusOf(const pg_result* result);
  absl::StatusOr<std::string> Prepare(const std::string& sql, const SqlParams& params);
  absl::Status Send(const std::string& name, const SqlParams& params);
  /// Receives the results of the statement that was sent, and visits their rows.
  absl::Status Receive(size_t index, Visit visit);
  absl::Status RunOne(const std::string& name, const SqlParams& params, Visit visit);
  absl::Status RunPipeline(const std::string& name, absl::Span<const SqlParams> batch, size_t first,
                           Visit visit);

  const std::string conninfo_;
  const Address address_;
  std::unique_ptr<pg_conn, Close> connection_;
  bool is_broken_ = false;  // found broken by a call; libpq may not have noticed yet
  std::unordered_map<std::string, std::string> prepared_;  // names by SQL
};

}  // namespace lumifold::ledger
