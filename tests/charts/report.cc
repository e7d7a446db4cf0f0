#include "tests/charts/report.h"

#include <cmath>
#include <functional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/baselines/baseline.h"
#include "filter/image/file_io.h"

namespace lumifold::charts {
namespace {

constexpr int kColumn = 17;  // the longest name of a baseline and a space

/// The error of `method`'s best on the film that `like` is of.
double BestError(absl::Span<const Row> rows, const Row& like, const std::string& method) {
  for (const Row& row : rows) {
    if (row.is_best && row.method == method && row.scene == like.scene && row.samples == like.samples)
      return row.mse255.whole;
  }
  return 0;
}

/// The rows of our default: one a film.
std::vector<Row> DefaultRows(absl::Span<const Row> rows) {
  std::vector<Row> defaults;
  for (const Row& row : rows) {
    if (row.method == "default") defaults.push_back(row);
  }
  return defaults;
}

double MeanBest(absl::Span<const Row> rows, const std::string& method) {
  const std::vector<Row> films = DefaultRows(rows);
  double sum = 0;
  for (const Row& film : films) sum += BestError(rows, film, method);
  return sum / static_cast<double>(films.size());
}

}  // namespace

absl::Status WriteCsv(const std::string& path, absl::Span<const Row> rows) {
  std::string text = "scene,spp,method,parameters,default,best,mse255";
  for (const std::string_view region : kRegionNames) absl::StrAppend(&text, ",mse255_", std::string(region));
  absl::StrAppend(&text, ",render_seconds,filter_seconds\n");
  for (const Row& row : rows) {
    // Parameters hold commas.
    absl::StrAppendFormat(&text, "%s,%d,%s,\"%s\",%d,%d,%.6g", row.scene, row.samples, row.method,
                          row.parameters, row.is_default, row.is_best, row.mse255.whole);
    for (const double error : row.mse255.of_region) absl::StrAppendFormat(&text, ",%.6g", error);
    absl::StrAppendFormat(&text, ",%.4f,%.4f\n", row.render_seconds, row.filter_seconds);
  }
  return WriteFileAtomically(path, text);
}

std::string RatioTable(absl::Span<const Row> rows) {
  std::string text = absl::StrFormat("%-14s%6s%10s%10s", "scene", "spp", "noisy", "default");
  for (const filter::Baseline& baseline : filter::Baselines())
    absl::StrAppendFormat(&text, "%*s", kColumn, baseline.name);
  absl::StrAppend(&text, "\n");
  const std::vector<Row> films = DefaultRows(rows);
  std::vector<double> logs(filter::Baselines().size());
  for (const Row& film : films) {
    const double error = film.mse255.whole;
    absl::StrAppendFormat(&text, "%-14s%6d%10.3f%10.3f", film.scene, film.samples,
                          BestError(rows, film, "none"), error);
    for (size_t i = 0; i < logs.size(); ++i) {
      const double ratio = error / BestError(rows, film, filter::Baselines()[i].name);
      logs[i] += std::log(ratio);
      absl::StrAppendFormat(&text, "%*.3f", kColumn, ratio);
    }
    absl::StrAppend(&text, "\n");
  }
  absl::StrAppendFormat(&text, "%-40s", "geometric mean");
  for (const double log : logs)
    absl::StrAppendFormat(&text, "%*.3f", kColumn, std::exp(log / static_cast<double>(films.size())));
  return absl::StrCat(text, "\n");
}

absl::Status CheckOrder(absl::Span<const Row> rows) {
  for (const Row& film : DefaultRows(rows)) {
    const double noisy = BestError(rows, film, "none");
    if (film.mse255.whole < noisy) continue;
    return absl::FailedPreconditionError(
        absl::StrFormat("%s, %d spp: default has MSE255 %.3f, the noisy picture %.3f", film.scene,
                        film.samples, film.mse255.whole, noisy));
  }
  const double ours = MeanBest(rows, "default");
  for (const filter::Baseline& baseline : filter::Baselines()) {
    const double theirs = MeanBest(rows, baseline.name);
    if (ours < theirs) continue;
    return absl::FailedPreconditionError(absl::StrFormat(
        "mean over all films: default has MSE255 %.3f, the best of %s %.3f", ours, baseline.name, theirs));
  }
  return absl::OkStatus();
}

}  // namespace lumifold::charts
