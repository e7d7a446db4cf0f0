#include "filter/manifold/selection.h"

#include <gtest/gtest.h>

#include <random>

namespace lumifold::filter {
namespace {

constexpr int kSize = 64;

/// Truth 1 on the left, 1 or 3 in 2-pixel stripes on the right; noise of standard deviation 0.3 a half.
float Truth(int x) { return x < kSize / 2 || x / 2 % 2 == 0 ? 1.0f : 3.0f; }

Halves NoisyHalves() {
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0.0f, 0.3f);
  Halves halves;
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight, &halves.share_a})
    *plane = Plane(kSize, kSize);
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight}) plane->Fill(1);
  halves.share_a.Fill(0.5f);
  halves.has_noise_estimate = true;
  for (Planes* half : {&halves.a, &halves.b}) {
    *half = MakePlanes(3, kSize, kSize);
    for (Plane& plane : *half) {
      for (int y = 0; y < kSize; ++y) {
        for (int x = 0; x < kSize; ++x) plane.At(x, y) = Truth(x) + noise(random);
      }
    }
  }
  return halves;
}

/// A filter that returns the left side's truth everywhere: perfect there, wrong on the stripes.
Candidate ConstantCandidate() {
  Candidate candidate{MakePlanes(3, kSize, kSize), MakePlanes(3, kSize, kSize)};
  for (Planes* half : {&candidate.a, &candidate.b}) {
    for (Plane& plane : *half) plane.Fill(1);
  }
  return candidate;
}

TEST(SelectCandidates, TakesTheFilterWhereItIsRightAndTheInputWhereItIsWrong) {
  const Halves halves = NoisyHalves();
  const Planes variance = PixelVariance(halves.a, halves.b, halves.share_a.view(), nullptr);
  std::vector<Candidate> candidates;
  candidates.push_back(ConstantCandidate());
  const Planes shares = SelectCandidates(halves, variance, candidates, {}, nullptr);
  ASSERT_EQ(shares.size(), 2u);
  EXPECT_GT(shares[1].At(10, 32), 0.95f);
  EXPECT_GT(shares[0].At(54, 32), 0.95f);
  for (int x = 0; x < kSize; ++x) EXPECT_NEAR(shares[0].At(x, 20) + shares[1].At(x, 20), 1.0f, 1e-5f);
}

}  // namespace
}  // namespace lumifold::filter
