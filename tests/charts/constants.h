#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "tests/charts/measure.h"
#include "tests/charts/page.h"

namespace lumifold::charts {

/// One constant of filter::TunedConstants() on one film: MSE255 of the default method as it is, with half the
/// constant, and with twice the constant.
struct ConstantPoint {
  std::string scene;
  int width = 0;
  int height = 0;
  int samples = 0;
  std::string constant;
  std::string unit;
  double value = 0;  // the default's for pictures of this size
  double error = 0;
  double halved_error = 0;
  double doubled_error = 0;
};

/// Filters a film with every tuned constant of the default method halved and doubled, one at a time.
std::vector<ConstantPoint> MeasureConstants(const Subject& subject, const Reference& reference,
                                            TaskPool* pool);

/// A Markdown table with one line per constant, in the order of their first points: its value, and for the
/// halved and the doubled constant the geometric mean over all films of the error over the default's, and the
/// largest. Films where an error is not above 0, within the noise of the reference, are left out.
std::string ConstantsTable(absl::Span<const ConstantPoint> points);

/// Writes constants.csv, with every point, and constants.md. Errors: kUnavailable naming the file.
absl::Status WriteConstants(const std::string& folder, absl::Span<const ConstantPoint> points,
                            const Provenance& provenance);

}  // namespace lumifold::charts
