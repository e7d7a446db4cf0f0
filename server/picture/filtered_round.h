#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
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

/// What a round is filtered for, to estimate its error. A target is compared with the error of the picture
/// itself; otherwise it is enough to know where it errs.
filter::FilterPurpose PurposeOfEstimates(const v1::JobSpec& spec);

/// ErrorsOf a frame after `round`, filtered for that.
/// Errors: as FilterRound.
absl::StatusOr<std::vector<double>> EstimateErrors(const v1::JobSpec& spec, int32_t frame,
                                                   const job::FrameRounds& rounds, int round,
                                                   const film::UnitSource& units, TaskPool* pool);

/// How they travel: each as float64, little-endian. `blocks`: their number.
std::string BytesOfErrors(absl::Span<const double> errors);
/// Errors: kDataLoss where they are not so many finite numbers.
absl::StatusOr<std::vector<double>> ErrorsOfBytes(const std::string& bytes, size_t blocks);
/// Bytes of those of a frame of the job.
uint64_t ErrorBytesOf(const v1::JobSpec& spec);

}  // namespace lumifold::server
