#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/stability/report.h"

namespace lumifold::stability {

/// The cells of a stability.csv that WriteReport() made; none where there is no such file. Cells of cases
/// that are no more, or that measured something else, are left out. Errors: kDataLoss naming file and line
/// for what WriteReport() did not write; those of reading the file.
absl::StatusOr<std::vector<Cell>> ReadCells(const std::string& path);

/// `cells` and, where they have none for a case and a column, those of `kept`.
std::vector<Cell> WithKept(std::vector<Cell> cells, const std::vector<Cell>& kept);

}  // namespace lumifold::stability
