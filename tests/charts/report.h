#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/measure.h"

namespace lumifold::charts {

/// Writes a line for each row, names in the first. Errors: kUnavailable naming the file.
absl::Status WriteCsv(const std::string& path, absl::Span<const Row> rows);

/// A line for each scene and sample count: the noisy picture's MSE255, our default's, and what the latter is
/// of each baseline's best; last the geometric means of those ratios.
std::string RatioTable(absl::Span<const Row> rows);

/// Whether our default is below the noisy picture everywhere and, in the mean over all films, below each
/// baseline's best. Errors: kFailedPrecondition naming the first that it is not.
absl::Status CheckOrder(absl::Span<const Row> rows);

}  // namespace lumifold::charts
