#include "server/job/frame_sampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace lumifold::job {
namespace {

constexpr int kEdge = 10 * kSampleBlock;  // pixels
constexpr size_t kSampledBlocks = 100;
constexpr double kBudget = 512;

SamplingSettings Settings() { return {.width = kEdge, .height = kEdge, .budget = kBudget}; }

std::vector<double> Ones() { return std::vector<double>(kSampledBlocks, 1.0); }

/// Rays of a sample of a scene in which an estimate costs as much as 10 samples.
std::vector<double> UsualCosts() { return std::vector<double>(kSampledBlocks, 4.0); }

/// The error of each block at its samples, if its amplitude is `amplitudes`.
std::vector<double> ErrorsAt(const Allocation& samples, const std::vector<double>& amplitudes) {
  std::vector<double> errors;
  for (size_t i = 0; i < samples.size(); ++i)
    errors.push_back(amplitudes[i] / std::pow(static_cast<double>(samples[i]), 0.75));
  return errors;
}

double MeanOf(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double MeanCost(const Allocation& samples, const std::vector<double>& costs) {
  double sum = 0;
  for (size_t i = 0; i < samples.size(); ++i) sum += samples[i] * costs[i];
  return sum / (MeanOf(costs) * static_cast<double>(samples.size()));
}

/// Runs all rounds of a frame whose errors decline as the policy assumes, and counts the estimates that
/// compare pictures.
FrameSampling RunFrame(const SamplingSettings& settings, const std::vector<double>& amplitudes,
                       const std::vector<double>& costs, int* comparisons = nullptr) {
  FrameSampling sampling(settings);
  for (size_t round = 1; !sampling.is_final() && round < sampling.rounds().size(); ++round) {
    const bool compares = sampling.NeedsPicture(costs);
    if (compares && comparisons != nullptr) ++*comparisons;
    sampling.AddEstimate(
        static_cast<int>(round),
        compares ? ErrorsAt(sampling.rounds()[round], amplitudes) : std::vector<double>(kSampledBlocks, -1.0),
        costs);
  }
  return sampling;
}

std::vector<double> OneLoudBlock(double amplitude) {
  std::vector<double> amplitudes = Ones();
  amplitudes[37] = amplitude;
  return amplitudes;
}

TEST(FrameSampling, SpendsASmallBudgetUniformly) {
  SamplingSettings settings = Settings();
  settings.budget = 63;
  const FrameSampling sampling(settings);
  EXPECT_TRUE(sampling.is_final());
  EXPECT_EQ(sampling.rounds(), std::vector<Allocation>({Allocation(kSampledBlocks, 63)}));
}

TEST(FrameSampling, BeginsWithUniformRounds) {
  const auto samples_of = [](double budget, double target_error) {
    SamplingSettings settings = Settings();
    settings.budget = budget;
    settings.target_error = target_error;
    const FrameSampling sampling(settings);
    EXPECT_FALSE(sampling.is_final());
    std::vector<uint32_t> samples;
    for (const Allocation& round : sampling.rounds()) {
      EXPECT_EQ(round, Allocation(kSampledBlocks, round[0]));
      samples.push_back(round[0]);
    }
    return samples;
  };
  EXPECT_EQ(samples_of(64, 0), std::vector<uint32_t>({16, 32, 48}));
  EXPECT_EQ(samples_of(512, 0), std::vector<uint32_t>({16, 48, 96}));
  EXPECT_EQ(samples_of(512, 1), std::vector<uint32_t>({16, 32, 48})) << "may need little of it";
}

TEST(FrameSampling, BeginsWithMoreSamplesWhereTheBudgetIsLarge) {
  SamplingSettings settings = Settings();
  settings.budget = 2048;
  EXPECT_EQ(FrameSampling(settings).rounds().front(), Allocation(kSampledBlocks, 64));
  settings.target_error = 1;
  EXPECT_EQ(FrameSampling(settings).rounds().front(), Allocation(kSampledBlocks, 16))
      << "may need little of it";
}

TEST(FrameSampling, FiltersNothingWhereThatCostsTooMuch) {
  SamplingSettings settings = Settings();
  settings.budget = 128;
  const FrameSampling dear(settings);  // an estimate of 10 samples is a thirteenth of it
  EXPECT_TRUE(dear.NeedsPicture(UsualCosts()));
  EXPECT_FALSE(dear.NeedsPicture(std::vector<double>(kSampledBlocks, 3.0)));
  int comparisons = 0;
  const FrameSampling sampling =
      RunFrame(settings, OneLoudBlock(100), std::vector<double>(kSampledBlocks, 3.0), &comparisons);
  EXPECT_EQ(comparisons, 0);
  EXPECT_TRUE(sampling.is_final());
  EXPECT_EQ(sampling.rounds().back(), Allocation(kSampledBlocks, 128));
  EXPECT_LT(sampling.PredictedError(), 0);
  settings.target_error = 1;
  EXPECT_TRUE(FrameSampling(settings).NeedsPicture(std::vector<double>(kSampledBlocks, 3.0)))
      << "nothing else tells when it is reached";
}

TEST(FrameSampling, SpendsAWholeBudgetInLargeFrames) {
  FrameSampling sampling({.width = 1024, .height = 768, .budget = 144});
  std::vector<double> costs(static_cast<size_t>(sampling.columns()) * static_cast<size_t>(sampling.rows()));
  for (size_t i = 0; i < costs.size(); ++i) costs[i] = 3 + 0.1 * static_cast<double>(i % 7);
  sampling.AddEstimate(1, std::vector<double>(costs.size(), -1), costs);
  ASSERT_TRUE(sampling.is_final());
  EXPECT_EQ(sampling.rounds().back(), Allocation(costs.size(), 144)) << "the rounding of a mean took a step";
}

TEST(FrameSampling, EstimatesAgainWhereThatSavesMoreThanItCosts) {
  SamplingSettings settings = Settings();
  std::vector<int> comparisons;
  for (const double budget : {128, 512, 2048, 8192}) {
    settings.budget = budget;
    const FrameSampling sampling =
        RunFrame(settings, OneLoudBlock(100), UsualCosts(), &comparisons.emplace_back());
    EXPECT_NEAR(sampling.MeanCostOf(static_cast<int>(sampling.rounds().size()) - 1, UsualCosts()), budget,
                kSampleStep);
  }
  EXPECT_EQ(comparisons, std::vector<int>({1, 2, 2, 3}));
}

TEST(FrameSampling, KeepsTheBudgetAndNeverTakesSamplesBack) {
  std::vector<double> amplitudes;
  std::vector<double> costs;
  for (size_t i = 0; i < kSampledBlocks; ++i) {
    amplitudes.push_back(std::pow(1.1, static_cast<double>(i)));
    costs.push_back(1 + static_cast<double>(i % 7));
  }
  const FrameSampling sampling = RunFrame(Settings(), amplitudes, costs);
  ASSERT_TRUE(sampling.is_final());
  const std::vector<Allocation>& rounds = sampling.rounds();
  for (size_t r = 1; r < rounds.size(); ++r) {
    for (size_t i = 0; i < kSampledBlocks; ++i) {
      EXPECT_GE(rounds[r][i], rounds[r - 1][i]);
      EXPECT_EQ(rounds[r][i] % kSampleStep, 0u);
    }
  }
  EXPECT_LE(MeanCost(rounds.back(), costs), kBudget);
  EXPECT_GE(MeanCost(rounds.back(), costs), kBudget - kSampleStep);
}

TEST(FrameSampling, GivesSamplesByErrorOverCost) {
  std::vector<double> amplitudes = Ones();
  std::vector<double> costs = UsualCosts();
  for (size_t i = 0; i < kSampledBlocks / 2; ++i) amplitudes[i] = 4;
  for (size_t i = kSampledBlocks / 2; i < kSampledBlocks; i += 2) costs[i] *= 2;
  const Allocation last = RunFrame(Settings(), amplitudes, costs).rounds().back();
  const double cheap = last[kSampledBlocks - 1];
  EXPECT_NEAR(last[0] / cheap, std::pow(4, 0.45), 0.05);
  EXPECT_NEAR(last[kSampledBlocks - 2] / cheap, std::pow(0.5, 0.45), 0.05);
}

TEST(FrameSampling, LowersTheErrorBelowThatOfUniformSampling) {
  std::vector<double> amplitudes;
  for (size_t i = 0; i < kSampledBlocks; ++i) amplitudes.push_back(std::pow(1.05, static_cast<double>(i)));
  const Allocation last = RunFrame(Settings(), amplitudes, UsualCosts()).rounds().back();
  const Allocation uniform(kSampledBlocks, static_cast<uint32_t>(kBudget));
  EXPECT_LT(MeanOf(ErrorsAt(last, amplitudes)), 0.9 * MeanOf(ErrorsAt(uniform, amplitudes)));
}

TEST(FrameSampling, GivesABlockThatLooksCleanItsShare) {
  std::vector<double> amplitudes = Ones();
  amplitudes[5] = 0;
  const Allocation last = RunFrame(Settings(), amplitudes, UsualCosts()).rounds().back();
  EXPECT_GE(last[5], 48u);  // a tenth of 512, rounded down
}

TEST(FrameSampling, LetsNoBlockDrawAllSamples) {
  const FrameSampling sampling = RunFrame(Settings(), OneLoudBlock(1e9), UsualCosts());
  const std::vector<Allocation>& rounds = sampling.rounds();
  for (size_t r = 1; r < rounds.size(); ++r) {
    const double growth = MeanCost(rounds[r], UsualCosts()) / MeanCost(rounds[r - 1], UsualCosts());
    EXPECT_LE(rounds[r][37], 8.2 * growth * rounds[r - 1][37]);
  }
  EXPECT_LE(rounds.back()[37], 16 * kBudget);
  EXPECT_GE(*std::min_element(rounds.back().begin(), rounds.back().end()), 48u);
}

TEST(FrameSampling, EndsABlackFrameEarly) {
  const FrameSampling sampling = RunFrame(Settings(), std::vector<double>(kSampledBlocks, 0.0), UsualCosts());
  EXPECT_TRUE(sampling.is_final());
  EXPECT_EQ(sampling.rounds().back(), FrameSampling(Settings()).rounds().back()) << "the uniform rounds";
  EXPECT_EQ(sampling.PredictedError(), 0);
}

TEST(FrameSampling, EndsAtTheTarget) {
  SamplingSettings settings = Settings();
  settings.target_error = 1 / std::pow(100.0, 0.75);  // of 100 samples, uniformly
  const FrameSampling sampling = RunFrame(settings, Ones(), UsualCosts());
  EXPECT_TRUE(sampling.is_final());
  EXPECT_LE(sampling.PredictedError(), settings.target_error);
  EXPECT_LT(sampling.rounds().back()[0], 200u);
}

TEST(FrameSampling, SpendsTheBudgetOnATargetOutOfReach) {
  SamplingSettings settings = Settings();
  settings.target_error = 1e-9;
  const FrameSampling sampling = RunFrame(settings, Ones(), UsualCosts());
  EXPECT_TRUE(sampling.is_final());
  EXPECT_NEAR(MeanCost(sampling.rounds().back(), Ones()), kBudget, kSampleStep);
  EXPECT_GT(sampling.PredictedError(), settings.target_error);
}

TEST(FrameSampling, KeepsWhatItKnowsOfBlocksWithoutNewSamples) {
  FrameSampling sampling(Settings());
  const std::vector<double> amplitudes = OneLoudBlock(20);
  sampling.AddEstimate(1, ErrorsAt(sampling.rounds()[1], amplitudes), UsualCosts());
  sampling.AddEstimate(2, std::vector<double>(kSampledBlocks, -1.0), UsualCosts());
  const Allocation& last = sampling.rounds().back();
  EXPECT_GT(last[37], 2 * last[0]);
}

TEST(FrameSampling, FollowsABudgetThatChanges) {
  SamplingSettings settings = Settings();
  settings.budget_changes = true;
  FrameSampling sampling(settings);
  sampling.SetBudget(100);
  for (size_t round = 1; !sampling.is_final(); ++round) {
    ASSERT_LT(round, sampling.rounds().size());
    sampling.AddEstimate(static_cast<int>(round), ErrorsAt(sampling.rounds()[round], Ones()), UsualCosts());
  }
  const int last = static_cast<int>(sampling.rounds().size()) - 1;
  EXPECT_NEAR(sampling.MeanCostOf(last, Ones()), 100, kSampleStep);
  FrameSampling spent(settings);
  spent.SetBudget(1);
  for (const int round : {1, 2}) {
    EXPECT_FALSE(spent.is_final());
    spent.AddEstimate(round, ErrorsAt(spent.rounds()[static_cast<size_t>(round)], Ones()), UsualCosts());
  }
  EXPECT_TRUE(spent.is_final());
  EXPECT_EQ(spent.rounds().size(), 3u) << "samples that were granted stay granted";
}

TEST(FrameSampling, MeasuresTheLastRoundWhereItHasNewSamples) {
  const FrameSampling sampling = RunFrame(Settings(), Ones(), UsualCosts());
  std::vector<double> errors(kSampledBlocks, 5.0);
  EXPECT_EQ(sampling.MeasuredError(errors), 5);
  errors.assign(kSampledBlocks, -1.0);
  EXPECT_EQ(sampling.MeasuredError(errors), sampling.PredictedError());
  std::fill(errors.begin(), errors.begin() + kSampledBlocks / 2, 5.0);
  EXPECT_NEAR(sampling.MeasuredError(errors), 0.5 * (5 + sampling.PredictedError()), 1e-6);
}

TEST(FrameSampling, CountsSmallerBlocksAtTheBorder) {
  const SamplingSettings settings = {
      .width = kSampleBlock + 1, .height = 2 * kSampleBlock + 1, .budget = kBudget};
  const FrameSampling sampling(settings);
  EXPECT_EQ(sampling.columns(), 2);
  EXPECT_EQ(sampling.rows(), 3);
  EXPECT_EQ(sampling.rounds().front().size(), 6u);
  EXPECT_EQ(sampling.PredictedError(), -1);
}

}  // namespace
}  // namespace lumifold::job
