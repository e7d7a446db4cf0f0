#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/metrics/flicker.h"
#include "tests/charts/page.h"

namespace lumifold::charts {

/// How an animation is rendered: once with a camera that stands still, once with one that turns about the
/// vertical by a part of a pixel from frame to frame. Every frame has its own seed.
struct FlickerSettings {
  int width = 0;
  int height = 0;
  int budget = 0;  // mean samples per pixel of an adaptive frame
  int reference_samples = 0;
  int frames = 16;
};

/// Change of the filtered picture from a frame to the next, in 8-bit steps.
struct FrameChange {
  std::string scene;
  bool camera_turns = false;
  int frame = 0;  // the earlier one
  metrics::Flicker reference;
  metrics::Flicker uniform;  // at the mean samples of the adaptive frames
  metrics::Flicker adaptive;
};

/// Renders the frames of a generated scene with both cameras, each three times: for reference, uniformly and
/// adaptively. References are kept in the cache folder. Errors: kNotFound for a scene that is not generated;
/// those of FilmSource.
absl::StatusOr<std::vector<FrameChange>> MeasureFrames(const std::string& scene,
                                                       const FlickerSettings& settings,
                                                       const std::string& cache_folder, TaskPool* pool);

/// Writes flicker.csv and flicker.md; the changes of a scene follow one another. Errors: those of the files.
absl::Status ChartFlicker(const std::string& folder, const std::vector<FrameChange>& changes,
                          const FlickerSettings& settings, const Provenance& provenance);

}  // namespace lumifold::charts
