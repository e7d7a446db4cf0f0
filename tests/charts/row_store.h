#pragma once

#include <map>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// The rows of former runs, in one file: a second run of a chart computes only new rows. A row's key contains
/// everything it depends on. Threads: one at a time; two programs may append to one file.
class RowStore {
 public:
  /// Errors: kUnavailable naming the file; kDataLoss naming the line that is not a row.
  static absl::StatusOr<RowStore> Open(const std::string& path);

  std::optional<Row> Find(const std::string& key) const;

  /// A later row replaces an earlier one with the same key. Errors: kUnavailable naming the file.
  absl::Status Add(const std::string& key, const Row& row);

 private:
  explicit RowStore(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::map<std::string, Row> rows_;
};

}  // namespace lumifold::charts
