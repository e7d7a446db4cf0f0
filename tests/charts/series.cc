#include "tests/charts/series.h"

#include <algorithm>
#include <cmath>

namespace lumifold::charts {
namespace {

std::vector<std::string> NamesOf(absl::Span<const Row> rows, std::string Row::* name) {
  std::vector<std::string> names;
  for (const Row& row : rows) {
    if (std::find(names.begin(), names.end(), row.*name) == names.end()) names.push_back(row.*name);
  }
  return names;
}

std::vector<Row> Chosen(absl::Span<const Row> rows, const std::string& scene, const std::string& method,
                        bool Row::* mark) {
  std::vector<Row> chosen;
  for (const Row& row : rows) {
    if (row.*mark && row.not_run.empty() && row.scene == scene && row.method == method &&
        row.errors.mse255.whole > 0) {
      chosen.push_back(row);
    }
  }
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const Row& a, const Row& b) { return a.samples < b.samples; });
  return chosen;
}

}  // namespace

std::vector<std::string> ScenesOf(absl::Span<const Row> rows) { return NamesOf(rows, &Row::scene); }

std::vector<std::string> MethodsOf(absl::Span<const Row> rows) { return NamesOf(rows, &Row::method); }

std::vector<Row> BestRows(absl::Span<const Row> rows, const std::string& scene, const std::string& method) {
  return Chosen(rows, scene, method, &Row::is_best);
}

std::vector<Row> DefaultRows(absl::Span<const Row> rows, const std::string& scene,
                             const std::string& method) {
  return Chosen(rows, scene, method, &Row::is_default);
}

std::optional<double> Interpolate(absl::Span<const std::pair<double, double>> points, double x) {
  for (size_t i = 1; i < points.size(); ++i) {
    const auto& [x0, y0] = points[i - 1];
    const auto& [x1, y1] = points[i];
    if (x < x0 || x > x1 || !(x1 > x0)) continue;
    const double t = std::log(x / x0) / std::log(x1 / x0);
    return y0 * std::pow(y1 / y0, t);
  }
  return std::nullopt;
}

std::vector<std::pair<double, double>> ErrorByTime(absl::Span<const Row> rows) {
  std::vector<std::pair<double, double>> points;
  for (const Row& row : rows) points.emplace_back(row.TotalSeconds(), row.errors.mse255.whole);
  return points;
}

}  // namespace lumifold::charts
