#include "filter/layers/selection.h"

#include <gtest/gtest.h>

#include <array>
#include <random>

namespace lumifold::filter {
namespace {

constexpr int kSize = 64;

/// Truth 1 on the left, 1 or 3 in 2-pixel stripes on the right; noise of standard deviation 0.3 a half.
float Truth(int x) { return x < kSize / 2 || x / 2 % 2 == 0 ? 1.0f : 3.0f; }

/// Sets each value of both halves to value(x, what it was).
template <typename Value>
void SetPixels(const std::array<Planes*, 2>& halves, const Value& value) {
  for (Planes* half : halves) {
    for (Plane& plane : *half) {
      for (int y = 0; y < kSize; ++y) {
        for (int x = 0; x < kSize; ++x) plane.At(x, y) = value(x, plane.At(x, y));
      }
    }
  }
}

Halves NoisyHalves() {
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0.0f, 0.3f);
  Halves halves;
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight, &halves.share_a})
    *plane = Plane(kSize, kSize);
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight}) plane->Fill(1);
  halves.share_a.Fill(0.5f);
  halves.has_noise_estimate = true;
  halves.level = 1.5f;
  for (Planes* half : {&halves.a, &halves.b}) *half = MakePlanes(3, kSize, kSize);
  SetPixels({&halves.a, &halves.b}, [&](int x, float) { return Truth(x) + noise(random); });
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
  const Candidate candidate = ConstantCandidate();
  const Planes shares = SelectCandidates(halves, variance, {&candidate}, {}, nullptr);
  ASSERT_EQ(shares.size(), 2u);
  EXPECT_GT(shares[1].At(10, 32), 0.95f);
  EXPECT_GT(shares[0].At(54, 32), 0.95f);
  for (int x = 0; x < kSize; ++x) EXPECT_NEAR(shares[0].At(x, 20) + shares[1].At(x, 20), 1.0f, 1e-5f);
}

/// A lamp's rim: a column 30 times as bright and as noisy as the dark about it.
constexpr int kRim = kSize / 2;

Halves RimInTheDark() {
  Halves halves = NoisyHalves();
  SetPixels({&halves.a, &halves.b}, [](int x, float value) {
    const float noise = value - Truth(x);
    return x == kRim ? 3.0f + noise : 0.1f + noise / 30;
  });
  halves.level = 0.15f;
  return halves;
}

/// Perfect on the rim, twice as bright as the truth beside it.
Candidate WrongBesideTheRim() {
  Candidate candidate = ConstantCandidate();
  SetPixels({&candidate.a, &candidate.b}, [](int x, float) { return x == kRim ? 3.0f : 0.2f; });
  return candidate;
}

TEST(SelectCandidates, LetsNoLampDecideForTheDarkBesideIt) {
  const Halves halves = RimInTheDark();
  const Planes variance = PixelVariance(halves.a, halves.b, halves.share_a.view(), nullptr);
  const Candidate candidate = WrongBesideTheRim();
  const Planes shares = SelectCandidates(halves, variance, {&candidate}, {}, nullptr);
  EXPECT_GT(shares[0].At(kRim - 2, 32), 0.95f);
}

TEST(SelectCandidates, JudgesADifferenceByTheLightOfThePicture) {
  Halves halves = RimInTheDark();
  // Of either sign: only the picture tells where the lamp is.
  SetPixels({&halves.a, &halves.b}, [](int x, float value) { return value - (x == kRim ? 3.0f : 0.1f); });
  Candidate candidate = WrongBesideTheRim();
  SetPixels({&candidate.a, &candidate.b}, [](int x, float) { return x == kRim ? 0.0f : 0.1f; });
  const Planes variance = PixelVariance(halves.a, halves.b, halves.share_a.view(), nullptr);
  const auto raw_share = [&] {
    return SelectCandidates(halves, variance, {&candidate}, {}, nullptr)[0].At(kRim - 2, 32);
  };
  EXPECT_LT(raw_share(), 0.5f);
  halves.picture_light = Plane(kSize, kSize);
  halves.picture_light.Fill(0.6f);
  for (int y = 0; y < kSize; ++y) halves.picture_light.At(kRim, y) = 20;
  EXPECT_GT(raw_share(), 0.95f);
}

}  // namespace
}  // namespace lumifold::filter
