#include "server/sampling/frame_sampling.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"
#include "filter/image/tile_samples.h"
#include "filter/metrics/error_estimate.h"

namespace lumifold::sampling {
namespace {

constexpr float kDecline = metrics::kErrorDecline;

constexpr uint32_t kFirstSamples = 8;  // of each of the uniform rounds
constexpr int kUniformRounds = 3;
/// Share of the mean samples that every block has.
constexpr double kUniformShare = 0.1;
constexpr double kMostGrowth = 4;
constexpr double kMostOverBudget = 16;
/// Estimates may take this part of the cost of samples, one in.
constexpr double kSamplesPerEstimate = 12;

uint32_t RoundDown(double samples) { return static_cast<uint32_t>(samples) / kSampleStep * kSampleStep; }

float Power(double value, float exponent) { return Pow(static_cast<float>(value), exponent); }

}  // namespace

FrameSampling::FrameSampling(const SamplingSettings& settings)
    : settings_(settings), columns_(BlocksIn(settings.width)), rows_(BlocksIn(settings.height)) {
  LUMIFOLD_CHECK(settings.width >= 1 && settings.height >= 1 && settings.budget >= 1);
  const auto blocks = static_cast<size_t>(columns_) * static_cast<size_t>(rows_);
  amplitudes_.resize(blocks);
  estimates_.resize(blocks);
  const auto budget = static_cast<uint32_t>(settings.budget);
  // The first estimate needs two pictures. Where they would cost too much there is nothing to decide.
  const bool pays = settings.budget >= 2 * kSamplesPerEstimate * settings.filter_cost ||
                    (settings.target_error > 0 && budget > kUniformRounds * kFirstSamples);
  if (!pays) {
    rounds_.emplace_back(blocks, budget);
    is_final_ = true;
    return;
  }
  for (uint32_t round = 1; round <= kUniformRounds; ++round)
    rounds_.emplace_back(blocks, round * kFirstSamples);
}

double FrameSampling::PixelsOf(size_t block) const {
  const int column = static_cast<int>(block) % columns_;
  const int row = static_cast<int>(block) / columns_;
  const int width = std::min(kSampleBlock, settings_.width - column * kSampleBlock);
  const int height = std::min(kSampleBlock, settings_.height - row * kSampleBlock);
  return static_cast<double>(width) * height;
}

void FrameSampling::Learn(const Allocation& samples, absl::Span<const double> errors) {
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
    sum += PixelsOf(i) * (errors[i] >= 0 ? errors[i] : BlockError(i, rounds_.back()[i]));
  return sum / (static_cast<double>(settings_.width) * settings_.height);
}

double FrameSampling::PredictedError() const {
  const bool is_known =
      std::any_of(estimates_.begin(), estimates_.end(), [](int count) { return count > 0; });
  return is_known ? MeasuredError(std::vector<double>(amplitudes_.size(), -1)) : -1;
}

double FrameSampling::MeanCost(const Allocation& samples, absl::Span<const double> costs) const {
  double sum = 0;
  double of_one = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    sum += PixelsOf(i) * costs[i] * samples[i];
    of_one += PixelsOf(i) * costs[i];
  }
  return sum / of_one;
}

Allocation FrameSampling::Distribute(double mean_cost, absl::Span<const double> costs) const {
  const Allocation& granted = rounds_.back();
  const double floor = kUniformShare * mean_cost;
  std::vector<double> wanted(granted.size());
  for (size_t i = 0; i < granted.size(); ++i) {
    const double amplitude = estimates_[i] > 0 ? amplitudes_[i] / estimates_[i] : 0;
    wanted[i] = Power(amplitude / costs[i], 1 / (1 + kDecline));
  }
  const auto scaled_by = [&](double factor) {
    Allocation next(granted.size());
    for (size_t i = 0; i < next.size(); ++i) {
      const double most = std::min(kMostGrowth * granted[i], kMostOverBudget * settings_.budget);
      next[i] = std::max(granted[i], RoundDown(std::min(std::max(factor * wanted[i], floor), most)));
    }
    return next;
  };
  // The largest factor whose cost stays within the limit; the cost rises with the factor.
  double low = 0;
  double high = 1;
  constexpr int kMostDoublings = 100;
  for (int i = 0; i < kMostDoublings && MeanCost(scaled_by(high), costs) <= mean_cost; ++i) {
    low = high;
    high *= 2;
  }
  constexpr int kHalvings = 40;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (MeanCost(scaled_by(middle), costs) <= mean_cost ? low : high) = middle;
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
  if (settings_.target_error > 0 && PredictedError() <= settings_.target_error) {
    is_final_ = is_last;  // otherwise the rounds under way are to confirm it
    return;
  }
  const double spent = MeanCost(rounds_.back(), costs);
  const double step = std::max(spent, kSamplesPerEstimate * settings_.filter_cost);
  Allocation next = Distribute(std::min(settings_.budget, spent + step), costs);
  // A budget that changes is never met exactly: no round for less than filtering it costs.
  const bool pays = !settings_.budget_changes || settings_.budget - spent >= settings_.filter_cost;
  const bool grows = pays && next != rounds_.back();
  if (grows) rounds_.push_back(std::move(next));
  const bool is_spent = MeanCost(rounds_.back(), costs) + kSampleStep >= settings_.budget;
  const bool may_go_on = settings_.target_error > 0 || settings_.budget_changes;
  is_final_ = (is_spent && !may_go_on) || (!grows && is_last);
}

}  // namespace lumifold::sampling
