#include "server/picture/filtered_round.h"

#include <utility>

#include "filter/image/planes.h"
#include "filter/image/tile_samples.h"
#include "filter/metrics/error_estimate.h"
#include "server/film/unit_film.h"

namespace lumifold::server {

absl::StatusOr<FilteredRound> FilterRound(const v1::JobSpec& spec, int32_t frame,
                                          const job::FrameRounds& rounds, int round,
                                          const film::UnitSource& units, filter::FilterPurpose purpose,
                                          TaskPool* pool, const FilterProgress& progress) {
  absl::StatusOr<film::UnitFilm> film = film::UnitFilm::Open(spec, frame, &units, pool, {&rounds, round + 1});
  if (!film.ok()) return film.status();
  absl::StatusOr<EdgedImage> read = film->Read({0, 0, film->width(), film->height()});
  if (!read.ok()) return read.status();
  absl::StatusOr<FilteredPicture> filtered = filter::FilterFilmWithDeviation(
      read->pixels, spec.filter().method(), pool, &read->edges, &read->fragments, purpose, {}, progress);
  if (!filtered.ok()) return filtered.status();
  return FilteredRound{*std::move(read), *std::move(filtered)};
}

std::vector<double> ErrorsOf(const FilteredRound& frame, const v1::JobSpec& spec, TaskPool* pool) {
  const auto metric = spec.adaptive().metric() == v1::ERROR_METRIC_REL_MSE ? metrics::ErrorMetric::kRelMse
                                                                           : metrics::ErrorMetric::kMse255;
  const metrics::FilteredFilm view = {frame.film.pixels, frame.filtered, &frame.film.edges};
  return metrics::EstimateError(view, kSampleBlock, metric, pool).blocks;
}

}  // namespace lumifold::server
