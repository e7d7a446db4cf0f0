#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/page.h"
#include "tests/charts/report.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// Writes the paper's Table 1 (errors) and Table 2 (times) anew, beside its own figures as ratios, for each
/// scene and sample count of the rows, to tables.md and the rows to tables.csv. `truths`: what the
/// rows are judged against. Errors: kUnavailable naming a file.
/// Source: Gruzdev, Frolov & Ignatenko 2015. Its unit of error is not stated: ratios alone compare.
absl::Status WritePaperTables(const std::string& folder, absl::Span<const Row> rows,
                              absl::Span<const Truth> truths, const Provenance& provenance);

}  // namespace lumifold::charts
