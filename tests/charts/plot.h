#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "tests/charts/measure.h"

namespace lumifold::charts {

/// Draws two charts a scene into `folder`, with both axes logarithmic and one curve a method, its best:
/// error against the time of rendering and filtering ("SCENE-time.svg"), and error against samples, with the
/// slope -1 of pure sampling ("SCENE-samples.svg"). The gnuplot scripts, data in them, stay beside the
/// pictures. A scene whose films have no times gets the second alone.
/// Result: whether there was a gnuplot to draw with. Errors: kUnavailable naming the file; kInternal where
/// gnuplot fails.
absl::StatusOr<bool> DrawCharts(const std::string& folder, absl::Span<const Row> rows);

}  // namespace lumifold::charts
