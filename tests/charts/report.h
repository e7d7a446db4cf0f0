#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// Writes a line for each row, names in the first. Errors: kUnavailable naming the file.
absl::Status WriteCsv(const std::string& path, absl::Span<const Row> rows);

/// A table of Markdown: for each scene and sample count the noisy picture's MSE255, our default's, and what
/// the latter is of each other method's best; last the geometric means of those ratios.
std::string RatioTable(absl::Span<const Row> rows);

/// Whether our default is below the noisy picture everywhere; at the most samples of each scene, on the front
/// of error and time that methods reach at their own settings; and, in the sum over all films, below each
/// image-space baseline's best.
/// Errors: kFailedPrecondition naming the first that it is not.
absl::Status CheckOrder(absl::Span<const Row> rows);

}  // namespace lumifold::charts
