#include "tests/charts/methods/samples/mutual_information.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace lumifold::charts {
namespace {

std::vector<uint8_t> RandomBins(size_t count, std::mt19937* random) {
  std::vector<uint8_t> bins;
  for (size_t i = 0; i < count; ++i) bins.push_back(static_cast<uint8_t>((*random)() % kBins));
  return bins;
}

TEST(MutualInformation, SortsByDeviations) {
  std::vector<uint8_t> bins;
  SortIntoBins({-1e30f, -1.6f, -1.4f, -0.4f, 0.4f, 0.6f, 1.4f, 1.6f, 1e30f}, &bins);
  EXPECT_EQ(bins, (std::vector<uint8_t>{0, 0, 1, 2, 2, 3, 3, 4, 4}));
}

TEST(MutualInformation, OfAVariableWithItselfIsItsEntropy) {
  const std::vector<uint8_t> bins = {0, 0, 0, 0, 1, 1, 2, 3};
  const double entropy = 0.5 * std::log(2.0) + 0.25 * std::log(4.0) + 2 * 0.125 * std::log(8.0);
  EXPECT_NEAR(MutualInformation(8).Of(bins, bins, false), entropy, 1e-6);
}

TEST(MutualInformation, OfAConstantIsNothing) {
  const std::vector<uint8_t> constant(6, 3);
  const std::vector<uint8_t> other = {0, 1, 2, 3, 4, 0};
  EXPECT_NEAR(MutualInformation(6).Of(constant, other, false), 0, 1e-7);
  EXPECT_EQ(MutualInformation(6).Of({}, {}, true), 0);
}

TEST(MutualInformation, IsTooHighForFewSamplesUnlessItsBiasIsTakenOff) {
  constexpr size_t kSamples = 100;
  constexpr int kTrials = 400;
  const MutualInformation information(kSamples);
  std::mt19937 random(1);
  double biased = 0;
  double unbiased = 0;
  for (int i = 0; i < kTrials; ++i) {
    const std::vector<uint8_t> a = RandomBins(kSamples, &random);
    const std::vector<uint8_t> b = RandomBins(kSamples, &random);
    biased += information.Of(a, b, false) / kTrials;
    unbiased += information.Of(a, b, true) / kTrials;
  }
  EXPECT_NEAR(biased, 16.0 / (2 * kSamples), 0.01);  // of independent variables, whose information is 0
  EXPECT_LT(unbiased, 0.02);                         // not 0: negative estimates are clamped
}

TEST(MutualInformation, LosesToItsBiasWhatAShuffleWouldShow) {
  constexpr size_t kSamples = 120;
  std::mt19937 random(2);
  const std::vector<uint8_t> a = RandomBins(kSamples, &random);
  std::vector<uint8_t> b = a;
  for (size_t i = 0; i < kSamples; i += 2) b[i] = static_cast<uint8_t>(random() % kBins);
  const MutualInformation information(kSamples);
  const double taken_off = information.Of(a, b, false) - information.Of(a, b, true);
  double shuffled = 0;
  for (int i = 0; i < 200; ++i) {
    std::shuffle(b.begin(), b.end(), random);
    shuffled += information.Of(a, b, false) / 200;
  }
  EXPECT_NEAR(taken_off, shuffled, 0.1 * shuffled);
}

}  // namespace
}  // namespace lumifold::charts
