#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/parallel.h"
#include "filter/methods.h"
#include "lumifold/v1/job.pb.h"
#include "server/film/unit_source.h"
#include "server/job/frame_rounds.h"

namespace lumifold::server {

/// A frame with adaptive sampling as it is after one of its rounds.
struct FilteredRound {
  EdgedImage film;
  FilteredPicture filtered;
};

/// Filters a frame after `round`, whose units are committed. `pool` may be null; the result does not depend
/// on it.
/// Errors: those of UnitFilm and FilterFilmWithDeviation.
absl::StatusOr<FilteredRound> FilterRound(const v1::JobSpec& spec, int32_t frame,
                                          const job::FrameRounds& rounds, int round,
                                          const film::UnitSource& units, filter::FilterPurpose purpose,
                                          TaskPool* pool, const FilterProgress& progress = nullptr);

/// Estimated errors, by block, in the metric of the job: as FrameSampling wants them.
std::vector<double> ErrorsOf(const FilteredRound& frame, const v1::JobSpec& spec, TaskPool* pool);

}  // namespace lumifold::server
