#include "tests/charts/report.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/baselines/baseline.h"
#include "filter/image/file_io.h"
#include "tests/charts/page.h"
#include "tests/charts/series.h"
#include "tests/charts/tuning_set.h"

namespace lumifold::charts {
namespace {

/// The error of the best run of `method` on the film of `like`, if it ran.
std::optional<double> BestError(absl::Span<const Row> rows, const Row& like, const std::string& method) {
  for (const Row& row : BestRows(rows, like.scene, method)) {
    if (row.samples == like.samples) return row.errors.mse255.whole;
  }
  return std::nullopt;
}

/// Why `method` did not run on the film of `like`; empty if it ran or has no row.
std::string WhyNotRun(absl::Span<const Row> rows, const Row& like, const std::string& method) {
  for (const Row& row : rows) {
    if (row.scene == like.scene && row.samples == like.samples && row.method == method) return row.not_run;
  }
  return "";
}

/// Another method's row with default parameters that has less error in less time than the default on one
/// scene; null if there is none. Parameters from the grid search do not count: they are fitted to that film.
const Row* BetterThan(absl::Span<const Row> rows, const Row& ours) {
  constexpr double kTimeMargin = 0.8;  // clocks are noisy
  for (const Row& row : rows) {
    const bool is_other = row.is_default && row.not_run.empty() && row.method != ours.method;
    if (is_other && row.scene == ours.scene && row.errors.mse255.whole < ours.errors.mse255.whole &&
        row.TotalSeconds() < kTimeMargin * ours.TotalSeconds()) {
      return &row;
    }
  }
  return nullptr;
}

/// The rows of the default method, one per film.
std::vector<Row> Films(absl::Span<const Row> rows) {
  std::vector<Row> films;
  for (const std::string& scene : ScenesOf(rows)) {
    for (const Row& row : DefaultRows(rows, scene, "default")) films.push_back(row);
  }
  return films;
}

std::vector<std::string> Others(absl::Span<const Row> rows) {
  std::vector<std::string> others = MethodsOf(rows);
  std::erase_if(others, [](const std::string& name) { return name == "none" || name == "default"; });
  return others;
}

/// The geometric mean of each column of ratios; 0 stands for a ratio that is not known.
std::vector<std::string> MeanCells(const std::vector<std::vector<double>>& lines, size_t columns) {
  std::vector<std::string> cells;
  for (size_t i = 0; i < columns; ++i) {
    double logs = 0;
    int count = 0;
    for (const std::vector<double>& ratios : lines) {
      if (ratios[i] <= 0) continue;
      logs += std::log(ratios[i]);
      ++count;
    }
    cells.push_back(count > 0 ? absl::StrFormat("%.3f", std::exp(logs / count)) : "");
  }
  return cells;
}

std::string MeanLine(const std::string& name, const std::vector<std::vector<double>>& lines, size_t columns) {
  std::vector<std::string> cells = {name, "", "", "", ""};
  const std::vector<std::string> means = MeanCells(lines, columns);
  cells.insert(cells.end(), means.begin(), means.end());
  return TableLine(cells);
}

}  // namespace

std::string HeadingOf(absl::Span<const Row> rows, const std::string& scene) {
  const auto row = std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.scene == scene; });
  return SceneHeading(scene, row->width, row->height);
}

std::string TruthTable(absl::Span<const Truth> truths) {
  std::string text = TableHead({"scene", "reference, spp", "MSE255 of its noise"});
  for (const Truth& truth : truths) {
    absl::StrAppend(&text, TableLine({truth.scene, absl::StrCat(truth.samples),
                                      truth.noise > 0 ? absl::StrFormat("%.3f", truth.noise) : "not known"}));
  }
  return text;
}

absl::Status WriteCsv(const std::string& path, absl::Span<const Row> rows) {
  std::string text = "scene,width,height,set,spp,method,parameters,default,best,not_run,mse255";
  for (const std::string_view region : metrics::kRegionNames)
    absl::StrAppend(&text, ",mse255_", std::string(region));
  absl::StrAppend(&text, ",rel_mse,ssim,flip,render_seconds,auxiliary_seconds,filter_seconds\n");
  for (const Row& row : rows) {
    // Parameters contain commas.
    absl::StrAppendFormat(&text, "%s,%d,%d,%s,%d,%s,\"%s\",%d,%d,\"%s\",%.6g", row.scene, row.width,
                          row.height, SetName(row.scene, row.width, row.height), row.samples, row.method,
                          row.parameters, row.is_default, row.is_best, row.not_run, row.errors.mse255.whole);
    for (const double error : row.errors.mse255.of_region) absl::StrAppendFormat(&text, ",%.6g", error);
    absl::StrAppendFormat(&text, ",%.6g,%s,%s,%.4f,%.4f,%.4f\n", row.errors.rel_mse, CsvCell(row.errors.ssim),
                          CsvCell(row.errors.flip), row.render_seconds, row.auxiliary_seconds,
                          row.filter_seconds);
  }
  return WriteFileAtomically(path, text);
}

std::string RatioTable(absl::Span<const Row> rows) {
  const std::vector<std::string> others = Others(rows);
  std::vector<std::string> head = {"scene", "set", "spp", "noisy", "default"};
  head.insert(head.end(), others.begin(), others.end());
  std::string text = TableHead(head);
  std::vector<std::vector<double>> tuning;
  std::vector<std::vector<double>> judged;
  for (const Row& film : Films(rows)) {
    const double error = film.errors.mse255.whole;
    std::vector<std::string> cells = {film.scene, SetName(film.scene, film.width, film.height),
                                      absl::StrCat(film.samples), ErrorCell(BestError(rows, film, "none")),
                                      ErrorCell(error)};
    std::vector<double> ratios(others.size());
    for (size_t i = 0; i < others.size(); ++i) {
      const double theirs = BestError(rows, film, others[i]).value_or(0);
      if (theirs <= 0) {
        const std::string why = WhyNotRun(rows, film, others[i]);
        cells.push_back(why.empty() ? "" : absl::StrCat("not run, ", why));
        continue;
      }
      ratios[i] = error / theirs;
      cells.push_back(absl::StrFormat("%.3f", ratios[i]));
    }
    absl::StrAppend(&text, TableLine(cells));
    (IsTuning(film.scene, film.width, film.height) ? tuning : judged).push_back(std::move(ratios));
  }
  if (!tuning.empty() && !judged.empty()) {
    absl::StrAppend(&text, MeanLine("geometric mean, tuning", tuning, others.size()),
                    MeanLine("geometric mean, judged", judged, others.size()));
  }
  tuning.insert(tuning.end(), judged.begin(), judged.end());
  return absl::StrCat(text, MeanLine("geometric mean", tuning, others.size()));
}

absl::Status CheckOrder(absl::Span<const Row> rows) {
  const std::vector<Row> films = Films(rows);
  for (const Row& film : films) {
    const double noisy = BestError(rows, film, "none").value_or(0);
    if (film.errors.mse255.whole >= noisy) {
      return absl::FailedPreconditionError(
          absl::StrFormat("%s, %d spp: default has MSE255 %.3f, the noisy picture %.3f", film.scene,
                          film.samples, film.errors.mse255.whole, noisy));
    }
    if (&film != &films.back() && (&film)[1].scene == film.scene)
      continue;  // the Pareto front: only at the largest sample count
    if (const Row* better = BetterThan(rows, film)) {
      return absl::FailedPreconditionError(
          absl::StrFormat("%s: %s at %d spp has less error in less time than default at %d", film.scene,
                          better->method, better->samples, film.samples));
    }
  }
  for (const filter::Baseline& baseline : filter::Baselines()) {
    double ours = 0;
    double theirs = 0;
    for (const Row& film : films) {
      const std::optional<double> best = BestError(rows, film, baseline.info.name);
      if (!best.has_value()) continue;  // it did not run
      ours += film.errors.mse255.whole;
      theirs += *best;
    }
    if (ours == 0 || ours < theirs) continue;
    return absl::FailedPreconditionError(
        absl::StrFormat("sum over all films: default has MSE255 %.3f, the best of %s %.3f", ours,
                        baseline.info.name, theirs));
  }
  return absl::OkStatus();
}

}  // namespace lumifold::charts
