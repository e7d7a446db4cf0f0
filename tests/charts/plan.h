#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "tests/charts/figure.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/job_run.h"
#include "tests/charts/mean_ratio.h"
#include "tests/charts/measure.h"
#include "tests/charts/page.h"

namespace lumifold::charts {

/// One of the two jobs of a pair.
struct PlannedJob {
  int64_t camera_paths = 0;  // the probe's included
  JobCosts costs = {};
  double mse255 = 0;  // against the reference, whose noise is taken off
};

/// A frame that was rendered and filtered twice with the same seed: with everything modelled, and by its
/// plan.
struct PlanPair {
  std::string scene = {};
  uint64_t seed = 0;
  bool is_diffuse = false;  // by the plan: light falls on diffuse materials, and there are no others
  std::map<std::string, int> differences = {};  // by name: the decisions that differ from the full plan
  PlannedJob full = {};
  PlannedJob planned = {};
};

/// Whether an error rises by at most 1 %, as far as twice the standard error can tell.
bool KeepsAccuracy(const MeanRatio& error);

/// Renders the pairs of a scene for seeds 1 to `seeds`, the full job first in every other pair. The samples
/// of `settings` are those of each job; its seed is not read. `scratch`: see RunJob.
/// Errors: those of the source and of RunJob.
absl::StatusOr<std::vector<PlanPair>> MeasurePlan(const std::string& scene, const FilmSource& source,
                                                  const FilmSettings& settings, int seeds,
                                                  const Reference& reference, const std::string& scratch,
                                                  TaskPool* pool);

/// What the plans of one scene decide otherwise than full ones, which may depend on the seed of the probe:
/// "levels 0, glossy off, pass-samples 64 to 256, levels 1 with some seeds".
std::string DifferencesOf(absl::Span<const PlanPair> pairs);

/// Draws the ratios ("plan-ratios") and writes plan.csv and plan.md; the pairs of a scene follow one another.
/// Result: whether there was a gnuplot. Errors: those of drawing and of the files.
absl::StatusOr<bool> ChartPlan(const std::string& folder, const std::vector<PlanPair>& pairs,
                               const FilmSettings& settings, const Provenance& provenance, DrawFormat format);

}  // namespace lumifold::charts
