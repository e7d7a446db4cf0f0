#include "tests/stability/kept_cells.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "filter/image/file_io.h"

namespace lumifold::stability {
namespace {

constexpr int64_t kMostBytes = int64_t{1} << 24;
constexpr size_t kFields = 6;  // after the name: empty, method, measure, threshold, figure, result

bool IsOf(const Cell& cell, int number, const std::string& column) {
  return cell.of->number == number && cell.column == column;
}

/// The cell of a case and column, created if missing; null for a case that no longer exists.
Cell* CellFor(int number, const std::string& column, std::vector<Cell>* cells) {
  for (Cell& cell : *cells) {
    if (IsOf(cell, number, column)) return &cell;
  }
  for (const Case& c : AllCases()) {
    if (c.number == number) return &cells->emplace_back(Cell{&c, column, {}, ""});
  }
  return nullptr;
}

/// Adds one line NUMBER,"NAME",METHOD,...: a figure, or the reason for its absence. Result: whether it is
/// valid.
bool AddLine(const std::string& line, std::vector<Cell>* cells) {
  const std::vector<std::string> around_name = absl::StrSplit(line, absl::MaxSplits('"', 2));
  const std::vector<std::string> fields =
      absl::StrSplit(around_name.back(), absl::MaxSplits(',', kFields - 1));
  int number = 0;
  if (around_name.size() != 3 || fields.size() != kFields ||
      !absl::SimpleAtoi(absl::StripSuffix(around_name[0], ","), &number)) {
    return false;
  }
  Cell* cell = CellFor(number, fields[1], cells);
  if (cell == nullptr) return true;
  absl::string_view reason = fields[5];
  if (absl::ConsumePrefix(&reason, kNotApplicable)) {
    cell->not_applicable = std::string(reason);
    return true;
  }
  double figure = 0;
  if (!absl::SimpleAtod(fields[4], &figure)) return false;
  const size_t next = cell->figures.size();
  const std::vector<Measure>& measures = cell->of->measures;
  // A measure of another name leaves the cell incomplete.
  if (next < measures.size() && measures[next].name == fields[2]) cell->figures.push_back(figure);
  return true;
}

/// Whether a figure is worse than the one before by more than the tolerance.
bool IsWorse(const Measure& measure, double before, double after) {
  constexpr double kTolerance = 0.05;
  constexpr double kFloor = 0.01;  // of the threshold
  if (!std::isfinite(after)) return std::isfinite(before);
  if (!measure.at_least && after <= kFloor * std::abs(measure.threshold)) return false;
  const double loss = measure.at_least ? before - after : after - before;
  return loss > kTolerance * std::abs(before);
}

}  // namespace

absl::StatusOr<std::vector<Cell>> ReadCells(const std::string& path) {
  const absl::StatusOr<std::string> text = ReadFile(path, kMostBytes);
  if (absl::IsNotFound(text.status())) return std::vector<Cell>();
  if (!text.ok()) return text.status();
  const std::vector<std::string> lines = absl::StrSplit(*text, '\n', absl::SkipEmpty());
  std::vector<Cell> cells;
  for (size_t i = 1; i < lines.size(); ++i) {  // below the header
    if (!AddLine(lines[i], &cells))
      return absl::DataLossError(absl::StrCat(path, ":", i + 1, ": not a cell"));
  }
  std::erase_if(cells, [](const Cell& cell) {
    return cell.IsApplicable() && cell.figures.size() != cell.of->measures.size();
  });
  return cells;
}

std::string Losses(const Cell& cell, const std::vector<Cell>& kept) {
  if (!cell.IsApplicable()) return "";
  const std::string name = absl::StrCat("case ", cell.of->number, ", ", cell.of->name);
  const auto before = std::find_if(kept.begin(), kept.end(),
                                   [&](const Cell& k) { return IsOf(k, cell.of->number, cell.column); });
  if (before == kept.end() || !before->IsApplicable()) return name + ": no figures are kept";
  std::vector<std::string> losses;
  for (size_t i = 0; i < cell.figures.size(); ++i) {
    const Measure& measure = cell.of->measures[i];
    if (!IsWorse(measure, before->figures[i], cell.figures[i])) continue;
    losses.push_back(absl::StrCat(name, ", ", measure.name, ": ", before->figures[i], " before, ",
                                  cell.figures[i], " now"));
  }
  return absl::StrJoin(losses, "\n  ");
}

std::vector<Cell> WithKept(std::vector<Cell> cells, const std::vector<Cell>& kept) {
  for (const Cell& old : kept) {
    const bool is_new = std::any_of(cells.begin(), cells.end(),
                                    [&](const Cell& cell) { return IsOf(cell, old.of->number, old.column); });
    if (!is_new) cells.push_back(old);
  }
  return cells;
}

}  // namespace lumifold::stability
