#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// The distinct scenes, or methods, of rows in order of appearance.
std::vector<std::string> ScenesOf(absl::Span<const Row> rows);
std::vector<std::string> MethodsOf(absl::Span<const Row> rows);

/// The rows of one scene and method that ran and have an error above 0, by samples: the best of each film's
/// grid, or the default.
std::vector<Row> BestRows(absl::Span<const Row> rows, const std::string& scene, const std::string& method);
std::vector<Row> DefaultRows(absl::Span<const Row> rows, const std::string& scene, const std::string& method);

/// Log-log linear interpolation of y at x; nothing outside the points, or for fewer than two. Points: x
/// rising, all above 0.
std::optional<double> Interpolate(absl::Span<const std::pair<double, double>> points, double x);

/// Pairs of total seconds and MSE255.
std::vector<std::pair<double, double>> ErrorByTime(absl::Span<const Row> rows);

}  // namespace lumifold::charts
