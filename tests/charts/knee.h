#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/charts/figure.h"
#include "tests/charts/measure.h"
#include "tests/charts/page.h"

namespace lumifold::charts {

/// The default method without one stage or guide, on one film: error and cost.
struct KneePoint {
  std::string scene;
  int width = 0;
  int height = 0;
  int samples = 0;
  std::string part;  // name of the stage or guide that is off; "nothing" for the whole method
  Errors errors;
  double seconds = 0;  // processor seconds of the filter
};

/// Filters a film with each stage and each guide of the default method switched off, one at a time.
std::vector<KneePoint> MeasureKnee(const Subject& subject, const Reference& reference, TaskPool* pool);

/// Draws what each part buys ("knee-error") and costs ("knee-cost"), and writes knee.csv and knee.md.
/// Result: whether there was a gnuplot. Errors: those of drawing and of the files.
absl::StatusOr<bool> ChartKnee(const std::string& folder, const std::vector<KneePoint>& points,
                               const Provenance& provenance, DrawFormat format);

}  // namespace lumifold::charts
