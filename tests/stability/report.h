#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "tests/stability/case.h"

namespace lumifold::stability {

/// What stability.csv says, before the reason, of a cell that is not applicable.
inline constexpr char kNotApplicable[] = "not applicable: ";

/// What one method did in one case.
struct Cell {
  const Case* of = nullptr;
  std::string column;
  std::vector<double> figures;  // empty: not applicable
  std::string not_applicable;   // why

  bool IsApplicable() const { return not_applicable.empty(); }
  bool Passes() const;
};

/// "0.013, 0.98 pass", "0.4 FAIL" or "not applicable".
std::string FormatCell(const Cell& cell);

/// What is wrong with a cell of our own method: it fails where no failure is known, or has become worse than
/// the known one. Empty where all is as it should be.
std::string Regression(const Cell& cell);

/// Writes FOLDER/stability.md, cases as rows and columns as columns with `about` (commit, machine, date)
/// above them, and FOLDER/stability.csv, a line a figure. Cells that there are none of stay empty. Errors:
/// kUnavailable naming the file.
absl::Status WriteReport(const std::string& folder, const std::string& about,
                         const std::vector<std::string>& columns, const std::vector<Cell>& cells);

}  // namespace lumifold::stability
