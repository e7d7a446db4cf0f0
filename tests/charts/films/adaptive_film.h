#pragma once

#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/metrics/error_estimate.h"
#include "server/job/frame_sampling.h"
#include "worker/render/renderer.h"

namespace lumifold::charts {

/// What adaptive sampling made of a frame, and what it cost.
struct AdaptiveFilm {
  EdgedImage film;
  Picture picture;             // filtered
  double mean_samples = 0;     // per pixel
  double estimated_error = 0;  // of the picture
  int filterings = 0;
  // Processor seconds, all threads together.
  double render_seconds = 0;
  double filter_seconds = 0;  // of all filterings
};

/// Renders a frame round by round as job::FrameSampling decides, and filters it, in this process.
AdaptiveFilm RenderAdaptively(const render::Renderer& renderer, const job::SamplingSettings& settings,
                              metrics::ErrorMetric metric, TaskPool* pool);

}  // namespace lumifold::charts
