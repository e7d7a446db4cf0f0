#include "server/picture/filtered_round.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
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

filter::FilterPurpose PurposeOfEstimates(const v1::JobSpec& spec) {
  return spec.adaptive().target_error() > 0 ? filter::FilterPurpose::kPicture
                                            : filter::FilterPurpose::kEstimate;
}

absl::StatusOr<std::vector<double>> EstimateErrors(const v1::JobSpec& spec, int32_t frame,
                                                   const job::FrameRounds& rounds, int round,
                                                   const film::UnitSource& units, TaskPool* pool) {
  const absl::StatusOr<FilteredRound> filtered =
      FilterRound(spec, frame, rounds, round, units, PurposeOfEstimates(spec), pool);
  if (!filtered.ok()) return filtered.status();
  return ErrorsOf(*filtered, spec, pool);
}

std::string BytesOfErrors(absl::Span<const double> errors) {
  static_assert(std::endian::native == std::endian::little);
  return {reinterpret_cast<const char*>(errors.data()), errors.size() * sizeof(double)};
}

absl::StatusOr<std::vector<double>> ErrorsOfBytes(const std::string& bytes, size_t blocks) {
  if (bytes.size() != blocks * sizeof(double))
    return absl::DataLossError(absl::StrCat("the errors of a round have ", bytes.size(), " bytes"));
  std::vector<double> errors(blocks);
  std::memcpy(errors.data(), bytes.data(), bytes.size());
  if (!std::all_of(errors.begin(), errors.end(), [](double error) { return std::isfinite(error); }))
    return absl::DataLossError("an error of a round is not finite");
  return errors;
}

uint64_t ErrorBytesOf(const v1::JobSpec& spec) {
  return sizeof(double) * static_cast<uint64_t>(BlocksIn(spec.width())) *
         static_cast<uint64_t>(BlocksIn(spec.height()));
}

}  // namespace lumifold::server
