#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/metrics/regions.h"

namespace lumifold::charts {

/// How far a picture is from the truth; the reference's own noise is taken off the first two.
struct Errors {
  metrics::RegionMeans mse255;
  double rel_mse = 0;
  // Of defaults alone: they take longer than many a filter. 0 else.
  double ssim = 0;
  double flip = 0;
};

/// One run of one method on one film. Seconds are processor seconds, all threads together.
struct Row {
  std::string scene;
  int width = 0;
  int height = 0;
  int samples = 0;
  std::string method;
  std::string parameters;
  bool is_default = false;  // of the method's own settings
  bool is_best = false;     // of the method's grid on this film
  std::string not_run;      // why there are no figures; empty where there are
  Errors errors;
  double render_seconds = 0;     // C alone; of a method that renders by itself, all it took
  double auxiliary_seconds = 0;  // what the layers, halves and features cost beside
  double filter_seconds = 0;

  double TotalSeconds() const { return render_seconds + auxiliary_seconds + filter_seconds; }
};

/// One line of JSON with all of a row.
std::string EncodeRow(const Row& row);

/// Errors: kDataLoss for text that EncodeRow did not make.
absl::StatusOr<Row> DecodeRow(std::string_view text);

}  // namespace lumifold::charts
