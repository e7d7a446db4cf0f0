#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/page.h"
#include "tests/charts/report.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// Reproduces the paper's Table 1 (errors) and Table 2 (times) for each scene and sample count of the rows,
/// with the paper's own ratios in brackets. Writes tables.md, and the rows to tables.csv. `truths`: the
/// references of the rows. Errors: kUnavailable naming a file.
/// Source: Gruzdev, Frolov & Ignatenko 2015. It states no unit of error, so only ratios can be compared.
absl::Status WritePaperTables(const std::string& folder, absl::Span<const Row> rows,
                              absl::Span<const Truth> truths, const Provenance& provenance);

}  // namespace lumifold::charts
