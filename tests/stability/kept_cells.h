#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/stability/report.h"

namespace lumifold::stability {

/// The cells of a stability.csv of WriteReport(); none if the file does not exist. Cells of cases that no
/// longer exist, or whose measures have other names or another number, are dropped. Errors: kDataLoss naming
/// file and line for text that WriteReport() does not write; those of reading the file.
absl::StatusOr<std::vector<Cell>> ReadCells(const std::string& path);

/// What the figures of `cell` have lost against those kept of its case and column: a line for each measure
/// that is worse by more than 5 %, with case, measure, figure before and after. A difference does not count
/// while the figure is within 1 % of the threshold of 0. A cell that was never kept is a line, too. Empty if
/// nothing is lost.
std::string Losses(const Cell& cell, const std::vector<Cell>& kept);

/// `cells`, and those of `kept` for cases and columns that `cells` lacks.
std::vector<Cell> WithKept(std::vector<Cell> cells, const std::vector<Cell>& kept);

}  // namespace lumifold::stability
