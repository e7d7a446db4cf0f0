#include "server/job/frame_sampling.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"
#include "filter/image/tile_samples.h"
#include "filter/metrics/error_estimate.h"

namespace lumifold::job {
namespace {

constexpr float kDecline = metrics::kErrorDecline;

/// Samples of a block are proportional to this power of its error over its cost. 1 / (1 + kDecline) = 0.57
/// would be best if errors were known, and if a block's samples served no other. Three scenes err less by 1
/// to 4 % with 0.45.
constexpr float kSpread = 0.45f;

/// Of the first uniform round: part of the budget, one in; at least so many.
constexpr double kFirstPart = 32;
constexpr double kLeastFirstSamples = 16;
/// Parts of the budget at the end of the second uniform round, which is estimated, and of the third, which is
/// under way meanwhile. Half of both: noisier estimates, 2 % more error in two of three scenes, and workers
/// that wait. A fifth more or less of the third: up to 1 % more or less error; workers wait where it is less.
constexpr double kSecondPart = 3.0 / 16;
constexpr double kThirdPart = 5.0 / 16;
/// Below this nothing is left to decide after the uniform rounds.
constexpr double kLeastBudget = 64;
/// Share of the mean samples that every block has.
constexpr double kUniformShare = 0.1;
/// Of a block in a round, over that of the mean.
constexpr double kMostGrowth = 8;
constexpr double kMostOverBudget = 16;
/// Of a mean over all blocks: a budget that is met exactly is not exceeded.
constexpr double kRounding = 1e-9;

uint32_t RoundDown(double samples) { return static_cast<uint32_t>(samples) / kSampleStep * kSampleStep; }

float Power(double value, float exponent) { return Pow(static_cast<float>(value), exponent); }

}  // namespace

FrameSampling::FrameSampling(const SamplingSettings& settings)
    : settings_(settings), columns_(BlocksIn(settings.width)), rows_(BlocksIn(settings.height)) {
  LUMIFOLD_CHECK(settings.width >= 1 && settings.height >= 1 && settings.budget >= 1);
  const auto blocks = static_cast<size_t>(columns_) * static_cast<size_t>(rows_);
  amplitudes_.resize(blocks);
  estimates_.resize(blocks);
  for (int y = 0; y < settings.height; y += kSampleBlock) {
    for (int x = 0; x < settings.width; x += kSampleBlock)
      pixels_.push_back(std::min(kSampleBlock, settings.width - x) *
                        std::min(kSampleBlock, settings.height - y));
  }
  if (settings.budget < kLeastBudget) {
    rounds_.emplace_back(blocks, static_cast<uint32_t>(settings.budget));
    is_final_ = true;
    return;
  }
  // What a target or a time needs is not known yet.
  const double known = EndsByEstimates() ? 0 : settings.budget;
  const uint32_t first = RoundDown(std::max(kLeastFirstSamples, known / kFirstPart));
  const uint32_t second = std::clamp(RoundDown(known * kSecondPart), 2 * first, 3 * first);
  const uint32_t third = std::clamp(RoundDown(known * kThirdPart), 3 * first, 6 * first);
  for (const uint32_t samples : {first, second, third}) rounds_.emplace_back(blocks, samples);
}

TileSamples FrameSampling::SamplesOf(const Rect& tile, size_t round) const {
  std::vector<SampleRange> blocks;
  for (int y = tile.y0; y < tile.y1; y += kSampleBlock) {
    for (int x = tile.x0; x < tile.x1; x += kSampleBlock) {
      const auto block = static_cast<size_t>(y / kSampleBlock) * static_cast<size_t>(columns_) +
                         static_cast<size_t>(x / kSampleBlock);
      blocks.push_back({round == 0 ? 0 : rounds_[round - 1][block], rounds_[round][block]});
    }
  }
  return {tile.width(), tile.height(), std::move(blocks)};
}

double FrameSampling::CostOfOne(absl::Span<const double> costs) const {
  double sum = 0;
  for (size_t i = 0; i < costs.size(); ++i) sum += pixels_[i] * costs[i];
  return sum / (static_cast<double>(settings_.width) * settings_.height);
}

double FrameSampling::SavedByEstimate(double samples) const {
  // Samples that are off by the factor exp(d) err like 1 - (1 + decline) / 2 d^2 of them; d is kSpread times
  // what the logarithm of the amplitude is off by, whose variance falls with the number of estimates.
  const double lost = (1 + kDecline) / 2 * kSpread * kSpread * metrics::kLogVarianceOfDrawnBlock;
  return samples * lost / (learned_ * (learned_ + 1.0));
}

void FrameSampling::Learn(const Allocation& samples, absl::Span<const double> errors) {
  if (std::any_of(errors.begin(), errors.end(), [](double error) { return error >= 0; })) ++learned_;
  for (size_t i = 0; i < errors.size(); ++i) {
    if (!(errors[i] >= 0)) continue;
    amplitudes_[i] += errors[i] * Power(samples[i], kDecline);
    ++estimates_[i];
  }
}

double FrameSampling::BlockError(size_t block, uint32_t samples) const {
  return estimates_[block] > 0 ? amplitudes_[block] / estimates_[block] / Power(samples, kDecline) : 0;
}

double FrameSampling::MeasuredError(absl::Span<const double> errors) const {
  LUMIFOLD_CHECK(errors.size() == amplitudes_.size());
  double sum = 0;
  for (size_t i = 0; i < errors.size(); ++i)
    sum += pixels_[i] * (errors[i] >= 0 ? errors[i] : BlockError(i, rounds_.back()[i]));
  return sum / (static_cast<double>(settings_.width) * settings_.height);
}

double FrameSampling::PredictedError() const {
  return IsKnown() ? MeasuredError(std::vector<double>(amplitudes_.size(), -1)) : -1;
}

double FrameSampling::MeanCost(const Allocation& samples, absl::Span<const double> costs) const {
  double all = 0;
  double one = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    const double cost = pixels_[i] * costs[i];
    all += cost * samples[i];
    one += cost;
  }
  return all / one;
}

Allocation FrameSampling::Distribute(double mean_cost, absl::Span<const double> costs) const {
  const Allocation& granted = rounds_.back();
  const double limit = mean_cost * (1 + kRounding);
  const double floor = kUniformShare * mean_cost;
  const double most_growth = kMostGrowth * mean_cost / MeanCost(granted, costs);
  std::vector<double> wanted(granted.size());
  for (size_t i = 0; i < granted.size(); ++i) {
    const double amplitude = estimates_[i] > 0 ? amplitudes_[i] / estimates_[i] : 0;
    wanted[i] = IsKnown() ? Power(amplitude / costs[i], kSpread) : 1;
  }
  const auto scaled_by = [&](double factor) {
    Allocation next(granted.size());
    for (size_t i = 0; i < next.size(); ++i) {
      const double most = std::min(most_growth * granted[i], kMostOverBudget * settings_.budget);
      next[i] = std::max(granted[i], RoundDown(std::min(std::max(factor * wanted[i], floor), most)));
    }
    return next;
  };
  // The largest factor whose cost stays within the limit; the cost rises with the factor.
  double low = 0;
  double high = 1;
  constexpr int kMostDoublings = 100;
  for (int i = 0; i < kMostDoublings && MeanCost(scaled_by(high), costs) <= limit; ++i) {
    low = high;
    high *= 2;
  }
  constexpr int kHalvings = 40;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (MeanCost(scaled_by(middle), costs) <= limit ? low : high) = middle;
  }
  return scaled_by(low);
}

void FrameSampling::SetBudget(double budget) {
  LUMIFOLD_CHECK(budget >= 1);
  settings_.budget = budget;
}

void FrameSampling::AddEstimate(int round, absl::Span<const double> errors, absl::Span<const double> costs) {
  LUMIFOLD_CHECK(!is_final_ && round >= 1 && round < static_cast<int>(rounds_.size()));
  LUMIFOLD_CHECK(errors.size() == amplitudes_.size() && costs.size() == amplitudes_.size());
  Learn(rounds_[static_cast<size_t>(round)], errors);
  const bool is_last = round + 1 == static_cast<int>(rounds_.size());
  if (IsKnown() && PredictedError() <= settings_.target_error) {
    is_final_ = is_last;  // otherwise the rounds under way are to confirm it
    return;
  }
  const double spent = MeanCost(rounds_.back(), costs);
  const double estimate = EstimateSamples(costs);
  const double left = settings_.budget - 2 * spent;  // after a round that doubles the samples
  const bool goes_on = EndsByEstimates() || (IsKnown() && SavedByEstimate(left) > estimate);
  const double step = std::max(spent, kBudgetPerEstimate * estimate);
  Allocation next = Distribute(goes_on ? std::min(settings_.budget, spent + step) : settings_.budget, costs);
  // A budget that changes is never met exactly: no round for less than its estimate costs.
  const bool pays = !settings_.budget_changes || settings_.budget - spent >= estimate;
  const bool grows = pays && next != rounds_.back();
  if (grows) rounds_.push_back(std::move(next));
  is_final_ = !goes_on || (!grows && is_last);
}

}  // namespace lumifold::job
