#pragma once

#include <cstdint>
#include <vector>

#include "absl/types/span.h"
#include "filter/image/rect.h"
#include "filter/image/tile_samples.h"

/// Adaptive sampling: where the samples of a frame go, decided at barriers from estimated errors and costs
/// alone. Pure state and policy: no clock, no threads, no files.
namespace lumifold::job {

/// Samples per pixel of each block of a frame (filter/image/tile_samples.h), row by row. Multiples of
/// kSampleStep.
using Allocation = std::vector<uint32_t>;

/// Two samples for each half.
inline constexpr uint32_t kSampleStep = 4;

struct SamplingSettings {
  int width = 0;  // of the frame in pixels
  int height = 0;
  /// Mean samples per pixel that the frame may have at most, in units of the mean cost of a sample. >= 1.
  double budget = 0;
  /// Sampling ends when the filtered picture's estimated error is at most this; 0: only the budget and a
  /// picture without error end it.
  double target_error = 0;
  /// Cost of an estimate, which filters the frame once without second filterings, in rays per pixel: two
  /// thirds of a whole filtering, which costs 43 to 74 in the chart's scenes at 256x192 and 512x384, more in
  /// smaller pictures (decision 21). Half as much: twice as many estimates in small budgets, which lose up to
  /// 10 % where they find nothing; twice as much: uniform sampling up to twice the budget.
  double estimate_rays = 40;
  /// SetBudget may be called: a frame whose budget looks spent waits for the estimate of its last round.
  bool budget_changes = false;
};

/// The samples of one frame as a sequence of rounds. Round r brings every block to its count in rounds()[r];
/// the first rounds are uniform. Two rounds are under way at a time, so that nobody waits for a decision: the
/// estimate for round r decides round r + 2. The rounds are a function of the settings and of the estimates.
///
/// Error of a block: amplitude / samples^0.75, which lies between the decline of noise and that of bias.
/// Samples go where the sum of errors falls most per cost: those of a block are proportional to (amplitude /
/// cost)^0.45. Bounds on that, because an estimate may be wrong:
///   - no block gets fewer than a tenth of the mean samples: one that looks clean may not have met its light
///     yet;
///   - no block grows more than eight times as much as the mean in a round, nor beyond 16 times the budget: a
///     firefly may not draw everything.
///
/// An estimate costs most of a filtering. The first one is made where that is at most one part in twelve of
/// the budget. A further one makes the amplitudes more precise, and is made where that saves more samples
/// than it costs, or where a target or a time needs it. Otherwise the next round spends the rest of the
/// budget.
/// Threads: one at a time.
class FrameSampling {
 public:
  explicit FrameSampling(const SamplingSettings& settings);

  int columns() const { return columns_; }
  int rows() const { return rows_; }

  /// The rounds decided so far; each block's count never falls from one to the next.
  const std::vector<Allocation>& rounds() const { return rounds_; }
  /// Sample indices that a round adds in a tile, whose corner is that of a block.
  TileSamples SamplesOf(const Rect& tile, size_t round) const;
  /// No round follows those decided so far.
  bool is_final() const { return is_final_; }
  /// Cost of a round's samples, those of the rounds before it included, over that of one sample of each
  /// pixel. `costs` as for AddEstimate.
  double MeanCostOf(int round, absl::Span<const double> costs) const {
    return MeanCost(rounds_[static_cast<size_t>(round)], costs);
  }
  /// Whether the estimate of a round is to filter the frame; `costs` as for AddEstimate. Otherwise
  /// AddEstimate takes errors that are all unknown, and the rest of the budget is spent uniformly.
  bool NeedsPicture(absl::Span<const double> costs) const { return NeedsPictureAt(CostOfOne(costs)); }
  /// The same where a sample has so many rays on average.
  bool NeedsPictureAt(double rays) const {
    return EndsByEstimates() || IsKnown() ||
           kBudgetPerEstimate * settings_.estimate_rays / rays <= settings_.budget;
  }
  /// Changes the budget for all further estimates. >= 1. Samples that were granted stay granted.
  void SetBudget(double budget);
  /// What is known once round `round` is complete; call it once for each round from 1 on, in order, until
  /// is_final. `errors`: by block, as metrics::EstimateError gives them for that round; negative: unknown.
  /// `costs`: rays of one sample of each pixel of a block, by block, above 0.
  void AddEstimate(int round, absl::Span<const double> errors, absl::Span<const double> costs);

  /// Error of the frame once all rounds decided so far are complete, as the estimates predict it; negative
  /// before the first.
  double PredictedError() const;
  /// The same, measured once they are complete: `errors` by block, as metrics::EstimateError gives them for
  /// the last round; blocks with a negative one count as predicted.
  double MeasuredError(absl::Span<const double> errors) const;

 private:
  /// The first estimate filters the frame, which may take this part of the budget, one in.
  static constexpr double kBudgetPerEstimate = 12;

  /// Cost of one sample of each pixel, per pixel.
  double CostOfOne(absl::Span<const double> costs) const;
  /// Cost of one estimate, in samples per pixel.
  double EstimateSamples(absl::Span<const double> costs) const {
    return settings_.estimate_rays / CostOfOne(costs);
  }
  /// Samples per pixel that one more estimate saves of the last `samples` of the budget.
  double SavedByEstimate(double samples) const;
  /// An error or a time, known only by estimates, ends sampling.
  bool EndsByEstimates() const { return settings_.target_error > 0 || settings_.budget_changes; }
  bool IsKnown() const { return learned_ > 0; }
  void Learn(const Allocation& samples, absl::Span<const double> errors);
  /// Predicted error of a block with these samples; 0 before its first estimate.
  double BlockError(size_t block, uint32_t samples) const;
  /// Cost of an allocation over that of one sample of each pixel.
  double MeanCost(const Allocation& samples, absl::Span<const double> costs) const;
  /// The best allocation of at most this mean cost that no block loses samples by.
  Allocation Distribute(double mean_cost, absl::Span<const double> costs) const;

  SamplingSettings settings_;
  int columns_;
  int rows_;
  std::vector<double> pixels_;  // by block
  std::vector<Allocation> rounds_;
  bool is_final_ = false;
  std::vector<double> amplitudes_;  // sums over the estimates so far, by block
  std::vector<int> estimates_;      // their number
  int learned_ = 0;                 // estimates that knew an error
};

}  // namespace lumifold::job
