#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "tests/charts/figure.h"
#include "tests/charts/page.h"
#include "tests/charts/report.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// Draws for each scene the error of each method at its best parameters: against total time, with the Pareto
/// front ("SCENE-time"), and against samples, with the slope -1 of unfiltered sampling ("SCENE-samples"). One
/// more chart shows for all scenes the ratio of times that unfiltered sampling and the default take to the
/// same error ("speed-up"). Scenes without times get the chart against samples only. Also writes the rows to
/// errors.csv, and tables and `truths` to errors.md. Result: whether gnuplot is installed. Errors: those of
/// drawing and of files.
absl::StatusOr<bool> ChartErrors(const std::string& folder, absl::Span<const Row> rows,
                                 absl::Span<const Truth> truths, const Provenance& provenance,
                                 DrawFormat format);

}  // namespace lumifold::charts
