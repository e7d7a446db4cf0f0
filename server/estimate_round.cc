#include "server/estimate_round.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/methods.h"
#include "filter/metrics/error_estimate.h"
#include "server/checked_file.h"
#include "server/committed_units.h"
#include "server/film/unit_film.h"

namespace lumifold::server {
namespace {

constexpr CheckedFileType kRoundsFile = {"LFR1", "the record of rounds", int64_t{1} << 30};

absl::StatusOr<v1::RoundEstimates> ReadEstimates(const std::string& path) {
  absl::StatusOr<std::string> bytes = ReadCheckedFile(path, kRoundsFile);
  v1::RoundEstimates estimates;
  if (absl::IsNotFound(bytes.status())) return estimates;
  if (!bytes.ok()) return bytes.status();
  if (!estimates.ParseFromString(*bytes)) return absl::DataLossError(absl::StrCat(path, ": cannot be read"));
  return estimates;
}

/// A frame as it is after one of its rounds, filtered.
struct FilteredRound {
  EdgedImage film;
  std::array<Plane, 3> picture;

  metrics::FilteredFilm View() const {
    return {film.pixels, {picture[0].view(), picture[1].view(), picture[2].view()}};
  }
};

/// Estimates one round of a frame.
class Estimator {
 public:
  Estimator(const v1::JobSpec& spec, int32_t frame, const job::FrameRounds& rounds,
            const CommittedUnits& units, TaskPool* pool)
      : spec_(spec), frame_(frame), rounds_(rounds), units_(units), tiles_(spec), pool_(pool) {}

  absl::StatusOr<v1::RoundEstimate> Estimate(int round) const {
    absl::StatusOr<FilteredRound> earlier = Filter(round - 1);
    if (!earlier.ok()) return earlier.status();
    absl::StatusOr<FilteredRound> later = Filter(round);
    if (!later.ok()) return later.status();
    const auto metric = spec_.adaptive().metric() == v1::ERROR_METRIC_REL_MSE ? metrics::ErrorMetric::kRelMse
                                                                              : metrics::ErrorMetric::kMse255;
    const metrics::ErrorEstimate errors =
        metrics::EstimateError(earlier->View(), later->View(), kSampleBlock, metric, pool_);
    absl::StatusOr<std::vector<double>> costs = Costs(round, errors);
    if (!costs.ok()) return costs.status();
    v1::RoundEstimate estimate;
    estimate.mutable_errors()->Add(errors.blocks.begin(), errors.blocks.end());
    estimate.mutable_costs()->Add(costs->begin(), costs->end());
    return estimate;
  }

 private:
  absl::StatusOr<FilteredRound> Filter(int round) const {
    absl::StatusOr<film::UnitFilm> film =
        film::UnitFilm::Open(spec_, frame_, &units_, pool_, {&rounds_, round + 1});
    if (!film.ok()) return film.status();
    absl::StatusOr<EdgedImage> read = film->Read({0, 0, film->width(), film->height()});
    if (!read.ok()) return read.status();
    absl::StatusOr<std::array<Plane, 3>> picture =
        filter::FilterFilm(read->pixels, spec_.filter().method(), pool_, &read->edges);
    if (!picture.ok()) return picture.status();
    return FilteredRound{*std::move(read), *std::move(picture)};
  }

  /// Rays of one sample of a tile's pixels so far; at least 1, for its cost is more than its rays.
  absl::StatusOr<double> CostOf(int32_t tile, int round) const {
    double rays = 0;
    double samples = 0;
    for (int32_t pass = 0; pass <= round; ++pass) {
      const job::UnitKey key = {frame_, tile, pass, v1::UNIT_KIND_PASS};
      if (!rounds_.Has(key)) continue;
      const absl::StatusOr<film::UnitOutline> outline = units_.Outline(key);
      if (!outline.ok()) return outline.status();
      rays += static_cast<double>(outline->rays);
      samples += static_cast<double>(rounds_.CameraSamplesOf(key));
    }
    return std::max(1.0, rays / samples);
  }

  absl::StatusOr<std::vector<double>> Costs(int round, const metrics::ErrorEstimate& blocks) const {
    std::vector<double> costs(blocks.blocks.size());
    for (int32_t tile = 0; tile < tiles_.tiles().count(); ++tile) {
      const absl::StatusOr<double> cost = CostOf(tile, round);
      if (!cost.ok()) return cost.status();
      const Rect rect = tiles_.tiles().RectOf(tile);
      for (int y = rect.y0; y < rect.y1; y += kSampleBlock) {
        for (int x = rect.x0; x < rect.x1; x += kSampleBlock)
          costs[static_cast<size_t>(y / kSampleBlock) * static_cast<size_t>(blocks.columns) +
                static_cast<size_t>(x / kSampleBlock)] = *cost;
      }
    }
    return costs;
  }

  const v1::JobSpec& spec_;
  const int32_t frame_;
  const job::FrameRounds& rounds_;
  const CommittedUnits& units_;
  const job::FrameUnits tiles_;
  TaskPool* const pool_;
};

}  // namespace

absl::StatusOr<job::FrameRounds> ReadRounds(const DataFolder& folder, const job::JobId& job,
                                            const v1::JobSpec& spec, int32_t frame) {
  const std::string path = folder.RoundsPath(job, frame);
  const absl::StatusOr<v1::RoundEstimates> estimates = ReadEstimates(path);
  if (!estimates.ok()) return estimates.status();
  absl::StatusOr<job::FrameRounds> rounds = job::FrameRounds::Replay(spec, *estimates);
  if (rounds.ok()) return rounds;
  return absl::Status(rounds.status().code(),
                      absl::StrCat(path, ": ", std::string(rounds.status().message())));
}

absl::StatusOr<v1::StageTimes> EstimateRound(const DataFolder& folder, ledger::JobStore& store,
                                             const job::JobId& job_id, int32_t frame, int round,
                                             TaskPool* pool, const std::function<absl::Time()>& now) {
  const absl::Time start = now();
  const absl::StatusOr<ledger::JobRecord> job = store.GetJob(job_id);
  if (!job.ok()) return job.status();
  const std::string path = folder.RoundsPath(job_id, frame);
  absl::StatusOr<v1::RoundEstimates> estimates = ReadEstimates(path);
  if (!estimates.ok()) return estimates.status();
  const absl::StatusOr<job::FrameRounds> rounds = job::FrameRounds::Replay(job->spec, *estimates);
  if (!rounds.ok()) return rounds.status();
  if (round < rounds->estimated()) return v1::StageTimes();
  if (round > rounds->estimated() || round >= rounds->count() || rounds->is_final())
    return absl::FailedPreconditionError(
        absl::StrCat("round ", round, " of frame ", frame, " is not to be estimated"));
  const absl::StatusOr<CommittedUnits> units = CommittedUnits::Open(folder, store, *job, frame);
  if (!units.ok()) return units.status();
  absl::StatusOr<v1::RoundEstimate> estimate =
      Estimator(job->spec, frame, *rounds, *units, pool).Estimate(round);
  if (!estimate.ok()) return estimate.status();
  *estimates->add_estimates() = *std::move(estimate);
  if (absl::Status status =
          WriteCheckedFile(path, kRoundsFile, estimates->SerializeAsString(), folder.files());
      !status.ok())
    return status;
  v1::StageTimes times;
  times.set_filter_seconds(absl::ToDoubleSeconds(now() - start));
  return times;
}

}  // namespace lumifold::server
