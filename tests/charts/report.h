#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// The reference of a scene.
struct Truth {
  std::string scene;
  int samples = 0;
  double noise = 0;  // MSE255 of the reference itself, which no error has; 0 if it has no halves
};

/// SceneHeading() of a scene of the rows.
std::string HeadingOf(absl::Span<const Row> rows, const std::string& scene);

/// A Markdown table with one line per reference.
std::string TruthTable(absl::Span<const Truth> truths);

/// Writes a header and one line per row. Errors: kUnavailable naming the file.
absl::Status WriteCsv(const std::string& path, absl::Span<const Row> rows);

/// A Markdown table: for each scene and sample count the MSE255 of the noisy picture and of the default, and
/// the ratio of the default's MSE255 to each other method's best, or why that method was not run. The last
/// lines have the geometric means of the ratios: over all films and, where there are both, over those of the
/// tuning set and over the judged ones.
std::string RatioTable(absl::Span<const Row> rows);

/// Checks three properties of the default: its error is below the noisy picture's on every film; at the
/// largest sample count of each scene it is on the Pareto front of error and time of all methods at their
/// defaults; and the sum of its errors over all films is below that of each image-space baseline at its best
/// parameters.
/// Errors: kFailedPrecondition naming the first violation.
absl::Status CheckOrder(absl::Span<const Row> rows);

}  // namespace lumifold::charts
