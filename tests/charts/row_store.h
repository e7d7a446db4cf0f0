#pragma once

#include <map>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// Rows there are already, in one file: a second run of a chart computes only what is new. A row's key says
/// all that decides it. Threads: one at a time; two programs may add to one file.
class RowStore {
 public:
  /// Errors: kUnavailable naming the file; kDataLoss naming the line that is no row.
  static absl::StatusOr<RowStore> Open(const std::string& path);

  std::optional<Row> Find(const std::string& key) const;

  /// A later row of a key takes the place of the earlier one. Errors: kUnavailable naming the file.
  absl::Status Add(const std::string& key, const Row& row);

 private:
  explicit RowStore(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::map<std::string, Row> rows_;
};

}  // namespace lumifold::charts
