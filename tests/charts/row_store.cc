#include "tests/charts/row_store.h"

#include <cstdint>
#include <cstdio>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "filter/image/file_io.h"

namespace lumifold::charts {

constexpr int64_t kMostBytes = int64_t{1} << 28;

absl::StatusOr<RowStore> RowStore::Open(const std::string& path) {
  RowStore store(path);
  const absl::StatusOr<std::string> text = ReadFile(path, kMostBytes);
  if (absl::IsNotFound(text.status())) return store;
  if (!text.ok()) return text.status();
  std::vector<std::string> lines = absl::StrSplit(*text, '\n');
  lines.pop_back();  // the text after the last newline: empty, or an incomplete line
  for (size_t i = 0; i < lines.size(); ++i) {
    const std::pair<std::string, std::string> parts = absl::StrSplit(lines[i], absl::MaxSplits('\t', 1));
    absl::StatusOr<Row> row = DecodeRow(parts.second);
    if (!row.ok()) return absl::DataLossError(absl::StrCat(path, ":", i + 1, ": ", row.status().message()));
    store.rows_[parts.first] = *std::move(row);
  }
  return store;
}

std::optional<Row> RowStore::Find(const std::string& key) const {
  const auto found = rows_.find(key);
  return found == rows_.end() ? std::nullopt : std::optional<Row>(found->second);
}

absl::Status RowStore::Add(const std::string& key, const Row& row) {
  const std::string line = absl::StrCat(key, "\t", EncodeRow(row), "\n");
  FILE* file = std::fopen(path_.c_str(), "a");
  const bool is_written = file != nullptr && std::fwrite(line.data(), 1, line.size(), file) == line.size();
  const bool is_closed = file != nullptr && std::fclose(file) == 0;
  if (!is_written || !is_closed) return absl::UnavailableError(absl::StrCat(path_, ": cannot be written to"));
  rows_[key] = row;
  return absl::OkStatus();
}

}  // namespace lumifold::charts
