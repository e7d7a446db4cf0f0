#include "server/ledger/sql_connection.h"

#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace lumifold::ledger {
namespace {

absl::Status CheckTexts(const SqlParams& params) {
  for (const SqlValue& value : params) {
    const auto* text = std::get_if<std::string_view>(&value);
    if (text == nullptr || text->find('\0') == std::string_view::npos) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("\"", absl::Utf8SafeCEscape(std::string(*text)), "\" has a NUL character"));
  }
  return absl::OkStatus();
}

}  // namespace

template <typename T>
T SqlRow::Take(std::optional<T> value) {
  ++next_column_;
  if (value.has_value()) return *std::move(value);
  is_readable_ = false;
  return {};
}

int64_t SqlRow::Int() { return Take(ReadInt(next_column_)); }

double SqlRow::Real() { return Take(ReadReal(next_column_)); }

std::string SqlRow::Text() { return Take(ReadText(next_column_)); }

std::string SqlRow::Bytes() { return Take(ReadBytes(next_column_)); }

absl::Status SqlConnection::RunBatch(const std::string& sql, absl::Span<const SqlParams> batch, Visit visit) {
  for (const SqlParams& params : batch) {
    if (absl::Status status = CheckTexts(params); !status.ok()) return status;
  }
  return batch.empty() ? absl::OkStatus() : RunChecked(sql, batch, visit);
}

absl::Status SqlConnection::Run(const std::string& sql, const SqlParams& params) {
  return RunBatch(sql, {params});
}

absl::Status SqlConnection::RunBatch(const std::string& sql, absl::Span<const SqlParams> batch) {
  return RunBatch(sql, batch, [](size_t, SqlRow&) {});
}

absl::Status SqlConnection::Query(const std::string& sql, const SqlParams& params,
                                  absl::FunctionRef<void(SqlRow&)> visit) {
  return RunBatch(sql, {params}, [visit](size_t, SqlRow& row) { visit(row); });
}

absl::StatusOr<std::optional<int64_t>> SqlConnection::QueryInt(const std::string& sql,
                                                               const SqlParams& params) {
  std::optional<int64_t> value;
  if (absl::Status status = Query(sql, params, [&value](SqlRow& row) { value = row.Int(); }); !status.ok())
    return status;
  return value;
}

absl::Status SqlConnection::InTransaction(absl::FunctionRef<absl::Status()> body) {
  if (absl::Status status = RunScript(dialect().begin); !status.ok()) return status;
  in_transaction_ = true;
  absl::Status status = body();
  if (status.ok()) status = RunScript("COMMIT");
  // A failed COMMIT may leave the transaction open; after a failed ROLLBACK there is nothing to undo.
  if (!status.ok()) RunScript("ROLLBACK").IgnoreError();
  in_transaction_ = false;
  return status;
}

}  // namespace lumifold::ledger
