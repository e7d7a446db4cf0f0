#include "tests/stability/report.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "tests/scenes/glb_writer.h"

namespace lumifold::stability {
namespace {

/// Relative tolerance for the figure of a known failure, for other compilers and libraries.
constexpr double kDrift = 0.05;

bool Passes(const Measure& measure, double figure) { return std::isfinite(figure) && measure.Passes(figure); }

std::string FormatFigure(double figure) {
  if (figure == 0) return "0";
  const double size = std::abs(figure);
  if (size >= 100) return absl::StrFormat("%.0f", figure);
  return size < 1e-3 ? absl::StrFormat("%.1e", figure) : absl::StrFormat("%.2g", figure);
}

std::string FormatFigures(const std::vector<double>& figures) {
  return absl::StrJoin(figures, ", ", [](std::string* out, double figure) { *out += FormatFigure(figure); });
}

std::string FormatThreshold(const Measure& measure) {
  return absl::StrCat(measure.name, measure.at_least ? " ≥ " : " ≤ ", measure.threshold);
}

std::string FormatThresholds(const Case& c) {
  return absl::StrJoin(c.measures, ", ", [](std::string* out, const Measure& measure) {
    absl::StrAppend(out, FormatThreshold(measure));
  });
}

/// Cells by case number, then by column.
using Matrix = std::map<int, std::map<std::string, const Cell*>>;

Matrix MatrixOf(const std::vector<Cell>& cells) {
  Matrix matrix;
  for (const Cell& cell : cells) matrix[cell.of->number][cell.column] = &cell;
  return matrix;
}

std::string MatrixTable(const std::vector<std::string>& columns, const Matrix& matrix) {
  std::string text = absl::StrCat("| # | case | measured, threshold | ", absl::StrJoin(columns, " | "),
                                  " |\n|--:|---|---|", std::string(4 * columns.size(), ' '));
  text.resize(text.size() - 4 * columns.size());
  for (size_t i = 0; i < columns.size(); ++i) text += "---|";
  text += "\n";
  std::map<std::string, int> passed, applicable;
  for (const auto& [number, row] : matrix) {
    const Case& c = *row.begin()->second->of;
    absl::StrAppend(&text, "| ", number, " | ", c.name, " | ", FormatThresholds(c), " |");
    for (const std::string& column : columns) {
      const auto found = row.find(column);
      if (found == row.end()) {
        text += " |";
        continue;
      }
      const Cell& cell = *found->second;
      absl::StrAppend(&text, " ", FormatCell(cell), " |");
      if (!cell.IsApplicable()) continue;
      ++applicable[column];
      passed[column] += cell.Passes() ? 1 : 0;
    }
    text += "\n";
  }
  text += "| | **passed, of those applicable** | |";
  for (const std::string& column : columns)
    absl::StrAppend(&text, " **", passed[column], " of ", applicable[column], "** |");
  return text + "\n";
}

std::string CaseTable(const Matrix& matrix) {
  std::string text =
      "| # | scene and measures | size | why a threshold differs from the first one "
      "|\n|--:|---|---|---|\n";
  for (const auto& [number, row] : matrix) {
    const Case& c = *row.begin()->second->of;
    absl::StrAppend(&text, "| ", number, " | ", c.what, " | ", c.size, " | ", c.threshold_note, " |\n");
  }
  return text;
}

std::string KnownFailures(const Matrix& matrix) {
  std::string text;
  for (const auto& [number, row] : matrix) {
    const Case& c = *row.begin()->second->of;
    if (!c.known.has_value()) continue;
    absl::StrAppend(&text, "* ", number, ", ", c.name, " (", FormatFigures(c.known->figures),
                    "): ", c.known->reason, "\n");
  }
  return text.empty() ? "None.\n" : text;
}

std::string NotApplicable(const std::vector<std::string>& columns, const std::vector<Cell>& cells) {
  std::string text;
  for (const std::string& column : columns) {
    std::map<std::string, std::vector<int>> cases_by_reason;
    for (const Cell& cell : cells) {
      if (cell.column == column && !cell.IsApplicable())
        cases_by_reason[cell.not_applicable].push_back(cell.of->number);
    }
    for (const auto& [reason, numbers] : cases_by_reason)
      absl::StrAppend(&text, "* ", column, ", cases ", absl::StrJoin(numbers, ", "), ": ", reason, "\n");
  }
  return text.empty() ? "Every method was run on every case.\n" : text;
}

std::string Csv(const std::vector<Cell>& cells) {
  std::string text = "case,name,method,measure,threshold,figure,result\n";
  for (const Cell& cell : cells) {
    for (size_t i = 0; i < cell.of->measures.size(); ++i) {
      const Measure& measure = cell.of->measures[i];
      absl::StrAppend(&text, cell.of->number, ",\"", cell.of->name, "\",", cell.column, ",", measure.name,
                      ",", measure.at_least ? ">=" : "<=", measure.threshold, ",");
      if (cell.IsApplicable()) {
        absl::StrAppend(&text, cell.figures[i], ",", Passes(measure, cell.figures[i]) ? "pass" : "fail",
                        "\n");
      } else {
        absl::StrAppend(&text, ",", kNotApplicable, cell.not_applicable, "\n");
      }
    }
  }
  return text;
}

std::string Page(const std::string& about, const std::vector<std::string>& columns,
                 const std::vector<Cell>& cells) {
  const Matrix matrix = MatrixOf(cells);
  return absl::StrCat(
      "# Where filters fail\n\nEvery method with its default parameters, in every case known to be hard. "
      "Figures are in the order of the measures. *error* is the squared error of the result over that of the "
      "noisy picture, in displayed values. `none` is the noisy picture itself. Made by `lumifold-stability "
      "--output docs/results`; ",
      about,
      ".\n`lumifold-stability --crop CASE:METHOD out.png` shows the pictures of a cell: noisy, filtered, "
      "truth.\n\n",
      MatrixTable(columns, matrix), "\n## The cases\n\n", CaseTable(matrix),
      "\n## Known failures of the default\n\nA test keeps their figures from becoming worse.\n\n",
      KnownFailures(matrix), "\n## Not applicable\n\n", NotApplicable(columns, cells));
}

}  // namespace

bool Cell::Passes() const {
  for (size_t i = 0; i < of->measures.size(); ++i) {
    if (!stability::Passes(of->measures[i], figures[i])) return false;
  }
  return true;
}

std::string FormatCell(const Cell& cell) {
  if (!cell.IsApplicable()) return "–";
  return absl::StrCat(FormatFigures(cell.figures), cell.Passes() ? " pass" : " **FAIL**");
}

std::string Regression(const Cell& cell) {
  if (!cell.IsApplicable() || cell.Passes()) return "";
  const Case& c = *cell.of;
  if (!c.known.has_value())
    return absl::StrCat("case ", c.number, ", ", c.name, ": ", FormatCell(cell), "; ", FormatThresholds(c));
  for (size_t i = 0; i < c.measures.size(); ++i) {
    const double worst = c.known->figures[i];
    const double drift = kDrift * std::abs(worst);
    const Measure held = {c.measures[i].name, c.measures[i].at_least ? worst - drift : worst + drift,
                          c.measures[i].at_least};
    if (!Passes(c.measures[i], cell.figures[i]) && !Passes(held, cell.figures[i])) {
      return absl::StrCat("case ", c.number, ", ", c.name, ": ", FormatCell(cell),
                          "; a known failure, but worse than ", FormatThreshold(held));
    }
  }
  return "";
}

absl::Status WriteReport(const std::string& folder, const std::string& about,
                         const std::vector<std::string>& columns, const std::vector<Cell>& cells) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return absl::UnavailableError(absl::StrCat(folder, ": ", error.message()));
  absl::Status status = scenes::WriteFile(absl::StrCat(folder, "/stability.csv"), Csv(cells));
  if (!status.ok()) return status;
  return scenes::WriteFile(absl::StrCat(folder, "/stability.md"), Page(about, columns, cells));
}

}  // namespace lumifold::stability
