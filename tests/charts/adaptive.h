#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/charts/figure.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/measure.h"
#include "tests/charts/page.h"

namespace lumifold::charts {

/// A frame that was rendered to a budget of samples, adaptively or uniformly, and filtered.
struct AdaptivePoint {
  std::string scene;
  int width = 0;
  int height = 0;
  int budget = 0;  // mean samples per pixel
  bool is_adaptive = false;
  double mse255 = 0;          // against the reference, whose noise is taken off
  double estimated = -1;      // by the policy; negative: uniform
  double render_seconds = 0;  // processor seconds, as those of the filter
  double filter_seconds = 0;  // of all filterings
  int filterings = 0;

  double TotalSeconds() const { return render_seconds + filter_seconds; }
};

/// Mean samples per pixel of a scene's pictures.
struct Budgets {
  std::vector<int> uniform;
  std::vector<int> adaptive;
};

/// Renders a frame to each budget. Errors: those of the source.
absl::StatusOr<std::vector<AdaptivePoint>> MeasureAdaptive(const std::string& scene, const FilmSource& source,
                                                           const FilmSettings& settings,
                                                           const Budgets& budgets, const Reference& reference,
                                                           TaskPool* pool);

/// Time of an adaptive point over that of uniform sampling at equal error, by interpolation between the
/// uniform points of its scene; 0 where they do not reach that error.
double TimeRatio(const std::vector<AdaptivePoint>& points, const AdaptivePoint& adaptive);

/// Draws error against time ("adaptive-error") and writes adaptive.csv and adaptive.md.
/// Result: whether there was a gnuplot. Errors: those of drawing and of the files.
absl::StatusOr<bool> ChartAdaptive(const std::string& folder, const std::vector<AdaptivePoint>& points,
                                   const Provenance& provenance, DrawFormat format);

}  // namespace lumifold::charts
