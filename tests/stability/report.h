#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "tests/stability/case.h"

namespace lumifold::stability {

/// Prefix of the reason in stability.csv for a cell that is not applicable.
inline constexpr char kNotApplicable[] = "not applicable: ";

/// The result of one method in one case.
struct Cell {
  const Case* of = nullptr;
  std::string column;
  std::vector<double> figures;  // empty: not applicable
  std::string not_applicable;   // the reason

  bool IsApplicable() const { return not_applicable.empty(); }
  bool Passes() const;
};

/// "0.013, 0.98 pass", "0.4 **FAIL**" or, for a cell that is not applicable, a dash.
std::string FormatCell(const Cell& cell);

/// The error of a cell of the default method: it fails without a known failure, or is worse than the known
/// one. Empty if neither.
std::string Regression(const Cell& cell);

/// Writes FOLDER/stability.md with one row per case and one column per method, below `about` (commit,
/// machine, date), and FOLDER/stability.csv with one line per figure. Missing cells stay empty. Errors:
/// kUnavailable naming the file.
absl::Status WriteReport(const std::string& folder, const std::string& about,
                         const std::vector<std::string>& columns, const std::vector<Cell>& cells);

}  // namespace lumifold::stability
