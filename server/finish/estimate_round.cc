#include "server/finish/estimate_round.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include "filter/image/file_io.h"
#include "proto/rpc/checked_file.h"
#include "server/commit/committed_units.h"
#include "server/film/unit_film.h"
#include "server/job/frame_list.h"
#include "server/picture/filtered_round.h"

namespace lumifold::server {
namespace {

/// The rounds follow from the estimates by job::FrameSampling: where it decides otherwise than before,
/// records of before would name other units than those committed, and the version is to be incremented.
constexpr rpc::CheckedFileType kRoundsFile = {"LFRB", "the record of rounds", int64_t{1} << 30};

/// Rays of one sample of a tile's pixels up to a round; at least 1, for its cost is more than its rays.
absl::StatusOr<double> CostOf(const job::FrameRounds& rounds, const CommittedUnits& units, int32_t frame,
                              int32_t tile, int round) {
  double rays = 0;
  double samples = 0;
  for (int32_t pass = 0; pass <= round; ++pass) {
    const job::UnitKey key = {frame, tile, pass, v1::UNIT_KIND_PASS};
    if (!rounds.Has(key)) continue;
    const absl::StatusOr<film::UnitOutline> outline = units.Outline(key);
    if (!outline.ok()) return outline.status();
    rays += static_cast<double>(outline->stats.rays());
    samples += static_cast<double>(rounds.CameraSamplesOf(key));
  }
  return std::max(1.0, rays / samples);
}

/// By block of the frame, row by row.
absl::StatusOr<std::vector<double>> Costs(const v1::JobSpec& spec, const job::FrameRounds& rounds,
                                          const CommittedUnits& units, int32_t frame, int round) {
  const job::FrameUnits tiles(spec);
  const auto columns = static_cast<size_t>(BlocksIn(spec.width()));
  std::vector<double> costs(columns * static_cast<size_t>(BlocksIn(spec.height())));
  for (int32_t tile = 0; tile < tiles.tiles().count(); ++tile) {
    const absl::StatusOr<double> cost = CostOf(rounds, units, frame, tile, round);
    if (!cost.ok()) return cost.status();
    const Rect rect = tiles.tiles().RectOf(tile);
    for (int y = rect.y0; y < rect.y1; y += kSampleBlock) {
      for (int x = rect.x0; x < rect.x1; x += kSampleBlock)
        costs[static_cast<size_t>(y / kSampleBlock) * columns + static_cast<size_t>(x / kSampleBlock)] =
            *cost;
    }
  }
  return costs;
}

/// Of the times that filtering takes: that for the picture over that for the estimate.
double PictureOverEstimate(const v1::JobSpec& spec) {
  return PurposeOfEstimates(spec) == filter::FilterPurpose::kPicture ? 1 : 1.5;
}

struct TimedErrors {
  std::vector<double> errors;
  absl::Duration filtering;
};

/// The errors that a worker has estimated, if they are here and whole; otherwise they are made here.
absl::StatusOr<TimedErrors> ErrorsOfRound(const DataFolder& folder, const RoundToEstimate& what,
                                          const v1::JobSpec& spec, const job::FrameRounds& rounds,
                                          const film::UnitSource& units, TaskPool* pool,
                                          const std::function<absl::Time()>& now) {
  if (what.filtered.has_value()) {
    const uint64_t bytes = ErrorBytesOf(spec);
    const absl::StatusOr<std::string> file =
        ReadFile(ErrorsPath(folder, what.job, what.frame, what.round), static_cast<int64_t>(bytes));
    absl::StatusOr<std::vector<double>> errors =
        file.ok() ? ErrorsOfBytes(*file, bytes / sizeof(double)) : file.status();
    if (errors.ok()) return TimedErrors{*std::move(errors), *what.filtered};
  }
  const absl::Time begun = now();
  absl::StatusOr<std::vector<double>> errors =
      EstimateErrors(spec, what.frame, rounds, what.round, units, pool);
  if (!errors.ok()) return errors.status();
  return TimedErrors{*std::move(errors), now() - begun};
}

/// Mean samples per pixel of a frame that fit the job's time, if samples go on being made as fast as those of
/// all frames so far, a sample of the frame costs what it cost up to the round, every frame gets the same
/// part of the time, and the result takes `filtering`; 0 without a time.
double BudgetOf(const RoundToEstimate& what, const v1::JobSpec& spec, const job::FrameRounds& rounds,
                absl::Span<const double> costs, absl::Duration filtering) {
  if (spec.adaptive().time_seconds() == 0) return 0;
  const double left = spec.adaptive().time_seconds() - absl::ToDoubleSeconds(filtering);
  const double pixels = static_cast<double>(spec.width()) * spec.height() * job::FrameList(spec).count();
  const std::vector<double> ones(costs.size(), 1);
  const double cost_of_sample = rounds.MeanCostOf(what.round, costs) / rounds.MeanCostOf(what.round, ones);
  const double budget = static_cast<double>(what.samples) / pixels * cost_of_sample * left /
                        std::max(absl::ToDoubleSeconds(what.rendered), 1e-3);
  return std::clamp(budget, 1.0, static_cast<double>(spec.samples_per_pixel()));
}

}  // namespace

std::string ErrorsPath(const DataFolder& folder, const job::JobId& job, int32_t frame, int round) {
  return absl::StrCat(folder.ResultPath(job, frame), ".round-", round, kPartialSuffix);
}

absl::StatusOr<v1::RoundEstimates> ReadEstimates(const std::string& path) {
  absl::StatusOr<std::string> bytes = rpc::ReadCheckedFile(path, kRoundsFile);
  v1::RoundEstimates estimates;
  if (absl::IsNotFound(bytes.status())) return estimates;
  if (!bytes.ok()) return bytes.status();
  if (!estimates.ParseFromString(*bytes)) return absl::DataLossError(absl::StrCat(path, ": cannot be read"));
  return estimates;
}

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

absl::StatusOr<v1::FrameReport> EstimateRound(const DataFolder& folder, ledger::JobStore& store,
                                              const RoundToEstimate& what, TaskPool* pool,
                                              const std::function<absl::Time()>& now) {
  const absl::Time start = now();
  const absl::StatusOr<ledger::JobRecord> job = store.GetJob(what.job);
  if (!job.ok()) return job.status();
  const std::string path = folder.RoundsPath(what.job, what.frame);
  absl::StatusOr<v1::RoundEstimates> estimates = ReadEstimates(path);
  if (!estimates.ok()) return estimates.status();
  const absl::StatusOr<job::FrameRounds> rounds = job::FrameRounds::Replay(job->spec, *estimates);
  if (!rounds.ok()) return rounds.status();
  const int round = what.round;
  if (round < rounds->estimated()) return v1::FrameReport();
  if (round > rounds->estimated() || round >= rounds->count() || rounds->is_final())
    return absl::FailedPreconditionError(
        absl::StrCat("round ", round, " of frame ", what.frame, " is not to be estimated"));
  const absl::StatusOr<CommittedUnits> units = CommittedUnits::Open(folder, store, *job, what.frame);
  if (!units.ok()) return units.status();
  const absl::StatusOr<std::vector<double>> costs = Costs(job->spec, *rounds, *units, what.frame, round);
  if (!costs.ok()) return costs.status();

  v1::RoundEstimate* estimate = estimates->add_estimates();
  estimate->mutable_costs()->Add(costs->begin(), costs->end());
  if (rounds->NeedsPicture(*costs)) {
    const absl::StatusOr<TimedErrors> made =
        ErrorsOfRound(folder, what, job->spec, *rounds, *units, pool, now);
    if (!made.ok()) return made.status();
    estimate->mutable_errors()->Add(made->errors.begin(), made->errors.end());
    estimate->set_budget(
        BudgetOf(what, job->spec, *rounds, *costs, PictureOverEstimate(job->spec) * made->filtering));
  } else {
    estimate->mutable_errors()->Resize(estimate->costs_size(), -1);
  }
  if (job->spec.adaptive().time_seconds() > 0)
    estimate->set_rendered_seconds(absl::ToDoubleSeconds(what.rendered));
  if (absl::Status status = CheckOwner(store, {what.job, what.epoch}); !status.ok()) return status;
  if (absl::Status status =
          rpc::WriteCheckedFile(path, kRoundsFile, estimates->SerializeAsString(), folder.files());
      !status.ok())
    return status;
  v1::FrameReport report;
  report.mutable_times()->set_filter_seconds(absl::ToDoubleSeconds(now() - start));
  return report;
}

}  // namespace lumifold::server
