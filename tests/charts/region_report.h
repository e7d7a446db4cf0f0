#pragma once

#include <string>

#include "absl/types/span.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// A Markdown table: for each film the MSE255 of the whole picture and of each region, SSIM and FLIP, for the
/// default, the noisy picture and the best point of every other method. "-" for a region without pixels and
/// for a score without a value.
std::string RegionTable(absl::Span<const Row> rows);

/// A Markdown paragraph that names every film and part of its picture (the whole, or a region) where the
/// default has more error than another method at its best point, with those methods and the ratio of the
/// default's error to theirs; or says that there is none.
std::string LossesText(absl::Span<const Row> rows);

}  // namespace lumifold::charts
