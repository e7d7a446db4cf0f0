#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// What the pictures of a scene are judged against.
struct Truth {
  std::string scene;
  int samples = 0;
  double noise = 0;  // MSE255 of the reference itself, which is taken off; 0 where it has no halves
};

/// A table of Markdown: a line for each truth.
std::string TruthTable(absl::Span<const Truth> truths);

/// Writes a line for each row, names in the first. Errors: kUnavailable naming the file.
absl::Status WriteCsv(const std::string& path, absl::Span<const Row> rows);

/// A table of Markdown: for each scene and sample count the noisy picture's MSE255, our default's, and what
/// the latter is of each other method's best, or why that was not run; last the geometric means of those
/// ratios.
std::string RatioTable(absl::Span<const Row> rows);

/// Whether our default is below the noisy picture everywhere; at the most samples of each scene, on the front
/// of error and time that methods reach at their own settings; and, in the sum over all films, below each
/// image-space baseline's best.
/// Errors: kFailedPrecondition naming the first that it is not.
absl::Status CheckOrder(absl::Span<const Row> rows);

}  // namespace lumifold::charts
