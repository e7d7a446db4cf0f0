#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/metrics/regions.h"

namespace lumifold::charts {

/// Errors of a picture; the first two are without the noise of the reference.
struct Errors {
  metrics::RegionMeans mse255;
  double rel_mse = 0;
  // Without a value where they would say nothing (HidesStructure()), or were not measured: only defaults are,
  // since these metrics take longer than many filters.
  std::optional<double> ssim;
  std::optional<double> flip;
};

/// One run of one method on one film. Seconds are processor seconds, summed over all threads.
struct Row {
  std::string scene;
  int width = 0;
  int height = 0;
  int samples = 0;
  std::string method;
  std::string parameters;
  bool is_default = false;  // run with the default parameters
  bool is_best = false;     // the best point of the method's grid on this film
  std::string not_run;      // why there are no figures; empty if there are
  Errors errors;
  double render_seconds = 0;     // C only; for a method that renders by itself, its whole cost
  double auxiliary_seconds = 0;  // additional cost of layers, halves and features
  double filter_seconds = 0;

  double TotalSeconds() const { return render_seconds + auxiliary_seconds + filter_seconds; }
};

/// The row as one line of JSON.
std::string EncodeRow(const Row& row);

/// The inverse. Errors: kDataLoss for any other text.
absl::StatusOr<Row> DecodeRow(std::string_view text);

}  // namespace lumifold::charts
