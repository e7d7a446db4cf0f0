#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/charts/figure.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/page.h"

namespace lumifold::charts {

/// A stage of a job: processor seconds of all threads together, and what it hands on.
struct Stage {
  std::string name;
  double seconds = 0;
  int64_t bytes = 0;  // 0 where nothing leaves
};

/// One job of one frame on this machine, stage by stage; and what its filtering is made of.
struct JobStages {
  std::string scene;
  FilmSettings settings;
  std::vector<Stage> job;
  std::vector<Stage> filter;
};

/// Renders, assembles, filters and writes a frame with the farm's own libraries, in one process: sending is
/// no part of it, but the bytes of units are what workers would send. `scratch`: the result goes there and is
/// deleted. Errors: those of the stages.
absl::StatusOr<JobStages> MeasureStages(const std::string& scene, const FilmSource& source,
                                        const FilmSettings& settings, const std::string& scratch,
                                        TaskPool* pool);

/// Draws the stages of all jobs ("stages"), and writes stages.csv and stages.md.
/// Result: whether there was a gnuplot. Errors: those of drawing and of the files.
absl::StatusOr<bool> ChartStages(const std::string& folder, const std::vector<JobStages>& jobs,
                                 const Provenance& provenance, DrawFormat format);

}  // namespace lumifold::charts
