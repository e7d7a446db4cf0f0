#pragma once

#include <array>
#include <string>

#include "filter/image/edged_image.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::film {

/// What the result file of a frame says beside its pixels. Nothing that differs between two runs of one job:
/// no id, date or duration.
struct ResultInfo {
  v1::JobSpec spec;
  int32_t frame = 0;
  std::string numeric_class;
};

/// Makes a frame's result, or some rows of it: `filtered` as R G B, coverage A, the usual layers of the film
/// (noisy, direct, indirect, albedo, emission), reflection1 (what those leave: C - (D + I) T - E, still
/// noisy), N, Z, distance.Z, id.Y; with save_film also all else the film has, and its edges, so that it can
/// be filtered again. Takes the film's planes over. `film` is what UnitFilm::Read gives, `filtered` has its
/// size.
EdgedImage BuildResult(EdgedImage film, std::array<Plane, 3> filtered, const ResultInfo& info);

}  // namespace lumifold::film
