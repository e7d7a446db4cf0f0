#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "tests/charts/figure.h"
#include "tests/charts/page.h"
#include "tests/charts/report.h"
#include "tests/charts/row.h"

namespace lumifold::charts {

/// Draws for each scene its methods' errors, each at its best parameters, against total time, with the front
/// of all ("SCENE-time"), and against samples, with the slope -1 of pure sampling ("SCENE-samples"); and for
/// all scenes together how much longer unfiltered sampling takes to our default's error ("speed-up"). The
/// rows go to errors.csv, what they say in words and tables to errors.md, with the `truths` they rest on.
/// Scenes without times get the second alone. Result: whether there was a gnuplot. Errors: those of drawing
/// and of the files.
absl::StatusOr<bool> ChartErrors(const std::string& folder, absl::Span<const Row> rows,
                                 absl::Span<const Truth> truths, const Provenance& provenance,
                                 DrawFormat format);

}  // namespace lumifold::charts
