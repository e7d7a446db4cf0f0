#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// The scenes, or the methods, of rows in the order they come, each once.
std::vector<std::string> ScenesOf(absl::Span<const Row> rows);
std::vector<std::string> MethodsOf(absl::Span<const Row> rows);

/// A scene's rows of one method by samples, those that ran and have an error over 0: the best of each film's
/// grid, or its default.
std::vector<Row> BestRows(absl::Span<const Row> rows, const std::string& scene, const std::string& method);
std::vector<Row> DefaultRows(absl::Span<const Row> rows, const std::string& scene, const std::string& method);

/// y at x on the line through the points on paper with two logarithmic axes; none outside the points, or for
/// fewer than two. Points: x rising, all over 0.
std::optional<double> Interpolate(absl::Span<const std::pair<double, double>> points, double x);

/// Error by total seconds.
std::vector<std::pair<double, double>> ErrorByTime(absl::Span<const Row> rows);

}  // namespace lumifold::charts
