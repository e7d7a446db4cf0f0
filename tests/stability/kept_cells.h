#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/stability/report.h"

namespace lumifold::stability {

/// The cells of a stability.csv of WriteReport(); none if the file does not exist. Cells of cases that no
/// longer exist, or whose number of measures has changed, are dropped. Errors: kDataLoss naming file and line
/// for text that WriteReport() does not write; those of reading the file.
absl::StatusOr<std::vector<Cell>> ReadCells(const std::string& path);

/// `cells`, and those of `kept` for cases and columns that `cells` lacks.
std::vector<Cell> WithKept(std::vector<Cell> cells, const std::vector<Cell>& kept);

}  // namespace lumifold::stability
