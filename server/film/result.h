#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "filter/image/edged_image.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"

namespace lumifold::film {

/// Metadata of a frame's result file. Contains nothing that differs between two runs of a job, such as ids,
/// dates or durations, so that the files are equal byte for byte.
struct ResultInfo {
  v1::JobSpec spec;
  int32_t frame = 0;
  std::string numeric_class;
  /// With adaptive sampling, where the error was estimated.
  std::optional<double> estimated_error = {};
  /// The budgets of a job with a time or a schedule: such a job with this schedule has the same picture.
  std::vector<double> schedule = {};
  /// Of the frame's geometry unit of tile 0: camera, and with Cryptomatte the objects.
  v1::UnitStats facts = {};
};

/// Makes the result of a frame, or some rows of it: `filtered` as R G B, coverage A, the layers noisy,
/// direct, indirect, albedo and emission, reflection1 (C - (D + I) T - E, not filtered), N, Z, distance.Z and
/// id.Y. With Cryptomatte also its layers. With save_film also all other channels of the film, its edges and
/// its fragments, so that it can be filtered again. Moves the planes of `film`, which is the output of
/// UnitFilm::Read; `filtered` has the same size.
EdgedImage BuildResult(EdgedImage film, std::array<Plane, 3> filtered, const ResultInfo& info);

}  // namespace lumifold::film
