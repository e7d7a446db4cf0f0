// Runs every method on every case in which filters are known to fail.
//
//   lumifold-stability                         all cells, as a table on stdout
//   lumifold-stability --column default --kept docs/results/stability.csv
//                                              the default method, compared with its kept figures:
//                                              what the gate runs, with --except for what takes long
//   lumifold-stability --output docs/results   writes stability.md and stability.csv; with --column or
//                                              --case, the other cells are kept from the existing CSV
//   lumifold-stability --crop 6:paper out.png  the pictures of a cell: noisy, filtered, truth, side by side
//
// Fails if the default method fails a case without a known failure, or is worse than a known one; with
// --kept, also if a figure of it is worse than the kept one by more than 5 %.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "filter/image/png_io.h"
#include "tests/stability/case.h"
#include "tests/stability/columns.h"
#include "tests/stability/kept_cells.h"
#include "tests/stability/report.h"

namespace lumifold::stability {
namespace {

// Exit codes; 0 is success.
constexpr int kFailure = 1;
constexpr int kUsageError = 2;

constexpr char kDefault[] = "default";

struct Options {
  std::vector<std::string> columns;
  std::vector<int> cases;
  std::vector<int> except;
  std::vector<std::string> crop;  // CASE:METHOD and a file
  std::string output;
  std::string kept;  // a stability.csv; empty: no comparison
  std::string about = "commit, machine and date not given";
  std::string cache = "lumifold-stability-cache";
  int threads = 1;
};

absl::StatusOr<Cell> RunCell(const Case& c, const Trial& trial) {
  Cell cell{&c, trial.column.name, {}, ""};
  absl::StatusOr<Finding> finding = c.run(trial);
  if (absl::IsUnimplemented(finding.status())) {
    cell.not_applicable = std::string(finding.status().message());
    return cell;
  }
  if (!finding.ok()) {
    return absl::Status(finding.status().code(), absl::StrCat("case ", c.number, ", ", trial.column.name,
                                                              ": ", finding.status().message()));
  }
  cell.figures = std::move(finding->figures);
  return cell;
}

bool Contains(const std::vector<int>& numbers, const Case& c) {
  return std::find(numbers.begin(), numbers.end(), c.number) != numbers.end();
}

bool IsAsked(const Options& options, const Case& c) {
  return (options.cases.empty() || Contains(options.cases, c)) && !Contains(options.except, c);
}

/// Appends the case's row.
absl::Status RunCase(const Options& options, const Case& c, const FilmStore& films, TaskPool* pool,
                     std::vector<Cell>* cells) {
  std::printf("%d %s:", c.number, c.name.c_str());
  for (const std::string& name : options.columns) {
    absl::StatusOr<Cell> cell = RunCell(c, {*FindColumn(name), films, pool});
    if (!cell.ok()) return cell.status();
    std::printf("  %s %s", name.c_str(), FormatCell(*cell).c_str());
    std::fflush(stdout);
    cells->push_back(*std::move(cell));
  }
  std::printf("\n");
  return absl::OkStatus();
}

/// Writes the page of all cells so far, and of the kept cells.
absl::Status WriteAll(const Options& options, const std::vector<Cell>& kept, const std::vector<Cell>& cells) {
  const std::vector<Cell> all = WithKept(cells, kept);
  std::vector<std::string> columns;
  for (const Column& column : AllColumns()) {
    if (std::any_of(all.begin(), all.end(), [&](const Cell& cell) { return cell.column == column.name; }))
      columns.push_back(column.name);
  }
  return WriteReport(options.output, options.about, columns, all);
}

/// Errors: kInternal with a line for each failure of the default method; those of reading the kept figures.
absl::Status CheckDefault(const Options& options, const std::vector<Cell>& cells) {
  absl::StatusOr<std::vector<Cell>> kept;
  if (!options.kept.empty()) {
    kept = ReadCells(options.kept);
    if (!kept.ok()) return kept.status();
  }
  std::string wrong;
  for (const Cell& cell : cells) {
    if (cell.column != kDefault) continue;
    if (const std::string regression = Regression(cell); !regression.empty())
      absl::StrAppend(&wrong, "\n  ", regression);
    if (options.kept.empty()) continue;
    if (const std::string losses = Losses(cell, *kept); !losses.empty())
      absl::StrAppend(&wrong, "\n  ", losses);
  }
  return wrong.empty() ? absl::OkStatus()
                       : absl::InternalError(absl::StrCat("the default method fails:", wrong));
}

absl::Status RunMatrix(const Options& options, const FilmStore& films, TaskPool* pool) {
  absl::StatusOr<std::vector<Cell>> kept;
  if (!options.output.empty()) kept = ReadCells(options.output + "/stability.csv");
  if (!options.output.empty() && !kept.ok()) return kept.status();
  std::vector<Cell> cells;
  for (const Case& c : AllCases()) {
    if (!IsAsked(options, c)) continue;
    if (absl::Status status = RunCase(options, c, films, pool, &cells); !status.ok()) return status;
    if (options.output.empty()) continue;
    // After each case, so that partial results can be read: a whole run takes long.
    absl::Status status = WriteAll(options, *kept, cells);
    if (!status.ok()) return status;
  }
  return CheckDefault(options, cells);
}

/// The three pictures side by side, with a gap in between.
LayeredImage SideBySide(const Exhibit& exhibit) {
  constexpr int kGap = 4;
  const ConstColorView whole = ViewOf(exhibit.truth);
  const Rect crop = exhibit.crop.IsEmpty() ? Rect{0, 0, whole[0].width(), whole[0].height()} : exhibit.crop;
  LayeredImage sheet(3 * crop.width() + 2 * kGap, crop.height());
  const ColorView out = sheet.AddColor("");
  int left = 0;
  for (const Picture* picture : {&exhibit.noisy, &exhibit.filtered, &exhibit.truth}) {
    for (size_t c = 0; c < 3; ++c) {
      CopyPlane((*picture)[c].view().Crop(crop), out[c].Crop({left, 0, left + crop.width(), crop.height()}));
    }
    left += crop.width() + kGap;
  }
  return sheet;
}

absl::Status Crop(const Options& options, const FilmStore& films, TaskPool* pool) {
  const std::vector<std::string> cell = absl::StrSplit(options.crop[0], ':');
  int number = 0;
  const Column* column = cell.size() == 2 ? FindColumn(cell[1]) : nullptr;
  const std::vector<Case>& all = AllCases();
  const auto found = std::find_if(all.begin(), all.end(), [&](const Case& c) {
    return absl::SimpleAtoi(cell[0], &number) && c.number == number;
  });
  if (column == nullptr || found == all.end())
    return absl::InvalidArgumentError(absl::StrCat("there is no cell ", options.crop[0]));
  const absl::StatusOr<Finding> finding = found->run({*column, films, pool});
  if (!finding.ok()) return finding.status();
  const LayeredImage sheet = SideBySide(finding->exhibit);
  return WritePng(options.crop[1], sheet.GetColor(""));
}

absl::Status Run(Options options) {
  if (options.columns.empty()) {
    for (const Column& column : AllColumns()) options.columns.push_back(column.name);
  }
  for (const std::string& name : options.columns) {
    if (FindColumn(name) == nullptr)
      return absl::InvalidArgumentError(absl::StrCat("no column is named '", name, "'"));
  }
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(options.threads);
  const FilmStore films(options.cache);
  return options.crop.empty() ? RunMatrix(options, films, pool.get()) : Crop(options, films, pool.get());
}

int Main(int argc, char** argv) {
  Options options;
  options.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  CLI::App app(
      "Runs every method on every case in which filters are known to fail.\n"
      "Exit codes: 0 done, 1 the default method does worse than allowed, 2 wrong usage.",
      "lumifold-stability");
  app.add_option("--column", options.columns, "Methods, such as default,paper (default: all)")
      ->delimiter(',');
  app.add_option("--case", options.cases, "Numbers of cases (default: all)")->delimiter(',');
  app.add_option("--except", options.except, "Numbers of cases to leave out")->delimiter(',');
  app.add_option("--crop", options.crop, "CASE:METHOD FILE: writes that cell's pictures as PNG")->expected(2);
  app.add_option("--output", options.output,
                 "Folder for stability.md and stability.csv; cells that are not run are kept");
  app.add_option("--kept", options.kept,
                 "stability.csv: the default method also fails where a figure is worse by more than 5 %");
  app.add_option("--about", options.about, "Commit, machine and date, for the page");
  app.add_option("--cache", options.cache, "Folder for films (default lumifold-stability-cache)");
  app.add_option("--threads", options.threads, "Threads (default: all)")->check(CLI::Range(1, 4096));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& wrong) {
    return app.exit(wrong) == 0 ? 0 : kUsageError;
  }
  const absl::Status status = Run(options);
  if (status.ok()) return 0;
  std::fprintf(stderr, "lumifold-stability: %s\n", std::string(status.message()).c_str());
  return absl::IsInvalidArgument(status) ? kUsageError : kFailure;
}

}  // namespace
}  // namespace lumifold::stability

int main(int argc, char** argv) { return lumifold::stability::Main(argc, argv); }
