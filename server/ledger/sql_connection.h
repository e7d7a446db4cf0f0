#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

namespace lumifold::ledger {

struct SqlBytes {
  std::string_view bytes;
};
/// A parameter of a statement: an integer, a number, text or bytes.
using SqlValue = std::variant<int64_t, double, std::string_view, SqlBytes>;
/// Values of the parameters $1, $2, ... of a statement. Texts and bytes are views that must outlive the call.
using SqlParams = std::vector<SqlValue>;

/// A row of a result. Columns are read in order, from the first.
class SqlRow {
 public:
  virtual ~SqlRow() = default;

  int64_t Int();
  double Real();
  std::string Text();
  std::string Bytes();
  /// False once a column had another type than was asked for, or was NULL; the value read was then 0 or
  /// empty.
  bool is_readable() const { return is_readable_; }

 private:
  virtual std::optional<int64_t> ReadInt(int column) = 0;
  virtual std::optional<double> ReadReal(int column) = 0;
  virtual std::optional<std::string> ReadText(int column) = 0;
  virtual std::optional<std::string> ReadBytes(int column) = 0;
  template <typename T>
  T Take(std::optional<T> value);

  int next_column_ = 0;
  bool is_readable_ = true;
};

/// Where the SQL of databases differs.
struct SqlDialect {
  /// Begins a transaction that will write.
  const char* begin;
  /// Ends a SELECT whose rows nobody else may change before the transaction ends.
  const char* for_update;
  /// Type of a column of bytes.
  const char* blob;
  /// Type of a key that counts up and never repeats.
  const char* serial;
  /// Ends a CREATE TABLE whose rows are stored in the order of the key.
  const char* clustered;
};

/// A connection to a database whose SQL is that of both SQLite and PostgreSQL.
/// Errors: kUnavailable with the cause for storage that may work again, kDataLoss for a malformed database,
/// kAlreadyExists for a value that must be unique, kInternal for what only a fault of ours can cause.
/// Threads: one at a time.
class SqlConnection {
 public:
  /// `index`: of the parameters that the row is a result of.
  using Visit = absl::FunctionRef<void(size_t index, SqlRow& row)>;

  virtual ~SqlConnection() = default;
  virtual const SqlDialect& dialect() const = 0;

  /// Runs a statement once for each set of parameters, in order, and visits the rows of the results. Stops at
  /// the first error. Rows may have been visited when an error is returned. `visit` must not use the
  /// connection.
  /// Errors: also kInvalidArgument for a text with a NUL character, which not every database can store.
  absl::Status RunBatch(const std::string& sql, absl::Span<const SqlParams> batch, Visit visit);
  /// Runs statements that have neither parameters nor results.
  virtual absl::Status RunScript(const std::string& sql) = 0;
  /// 0 where there is no schema. SetSchemaVersion is part of the transaction that it is called in.
  virtual absl::StatusOr<int64_t> SchemaVersion() = 0;
  virtual absl::Status SetSchemaVersion(int64_t version) = 0;

  absl::Status Run(const std::string& sql, const SqlParams& params);
  absl::Status RunBatch(const std::string& sql, absl::Span<const SqlParams> batch);
  absl::Status Query(const std::string& sql, const SqlParams& params, absl::FunctionRef<void(SqlRow&)> visit);
  /// The integer in the first column of the last row; nullopt if there is no row.
  absl::StatusOr<std::optional<int64_t>> QueryInt(const std::string& sql, const SqlParams& params);
  /// Runs `body` in a transaction, which is rolled back if `body` returns an error.
  absl::Status InTransaction(absl::FunctionRef<absl::Status()> body);

 protected:
  /// Between BEGIN and the end of the transaction.
  bool in_transaction() const { return in_transaction_; }

 private:
  virtual absl::Status RunChecked(const std::string& sql, absl::Span<const SqlParams> batch, Visit visit) = 0;

  bool in_transaction_ = false;
};

}  // namespace lumifold::ledger
