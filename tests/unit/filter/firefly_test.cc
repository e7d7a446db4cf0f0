#include "filter/denoise/firefly.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <utility>

#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

constexpr int kNoiseRadius = 12;
constexpr float kFireflyReach = 16;

Halves FlatHalves(int width, int height, float value) {
  Halves halves;
  halves.a = MakePlanes(3, width, height);
  halves.b = MakePlanes(3, width, height);
  for (Planes* half : {&halves.a, &halves.b}) {
    for (Plane& plane : *half) plane.Fill(value);
  }
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight}) {
    *plane = Plane(width, height);
    plane->Fill(1);
  }
  halves.share_a = Plane(width, height);
  halves.share_a.Fill(0.5f);
  halves.has_noise_estimate = true;
  return halves;
}

void SetBoth(int x, int y, float value, Halves* halves) {
  for (Planes* half : {&halves->a, &halves->b}) {
    for (Plane& plane : *half) plane.At(x, y) = value;
  }
}

TEST(Fireflies, AreCutToTheBoundAndWhatTheyLoseIsKept) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
  const std::array<Planes, 2> removed = SuppressFireflies({}, kNoiseRadius, &halves, nullptr);
  ASSERT_EQ(removed[0].size(), 3u);
  EXPECT_NEAR(halves.a[0].At(5, 4), 2.0f, 1e-3f);
  EXPECT_EQ(halves.b[0].At(5, 4), 1.0f);
  EXPECT_NEAR(removed[0][0].At(5, 4), 998.0f, 1e-2f);
  EXPECT_EQ(removed[0][0].At(4, 4), 0.0f);
  EXPECT_EQ(removed[1][0].At(5, 4), 0.0f);  // B lost nothing
}

TEST(Fireflies, AnExcessThatTheOtherHalfShowsMostOfStays) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 10.0f;
  for (Plane& plane : halves.b) plane.At(5, 4) = 6.5f;  // over half of the excess over the bound, 2
  EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  for (Plane& plane : halves.b) plane.At(5, 4) = 5.5f;  // less than half
  ASSERT_FALSE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  EXPECT_NEAR(halves.a[0].At(5, 4), 2.0f, 1e-3f);
  EXPECT_EQ(halves.b[0].At(5, 4), 5.5f);
}

// Of the 25 pixels of the window, 19 are dark. That is one more than the quantile needs.
TEST(Fireflies, AreJudgedByEachSideOfTheWindow) {
  for (const auto& [dx, dy] : {std::pair(-2, 0), {2, 0}, {0, -2}, {0, 2}}) {
    Halves halves = FlatHalves(11, 9, 1.0f);
    for (int i = -2; i <= 2; ++i) SetBoth(5 + (dx != 0 ? dx : i), 4 + (dy != 0 ? dy : i), 1e4f, &halves);
    for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
    ASSERT_FALSE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty()) << dx << "," << dy;
    EXPECT_NEAR(halves.a[0].At(5, 4), 2.0f, 1e-3f) << dx << "," << dy;
  }
}

TEST(Fireflies, BrightPixelsThatBothHalvesSeeStay) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  SetBoth(5, 4, 1000, &halves);
  EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  EXPECT_EQ(halves.a[1].At(5, 4), 1000.0f);
}

/// Halves of which every second pixel has nothing in one of them.
Halves NoisyHalves() {
  Halves halves = FlatHalves(11, 9, 0.0f);
  for (Planes* half : {&halves.a, &halves.b}) {
    for (Plane& plane : *half) {
      for (int y = 0; y < 9; ++y) {
        for (int x = 0; x < 11; ++x)
          plane.At(x, y) = (x + y) % 2 == (half == &halves.a ? 0 : 1) ? 2.0f : 0.0f;
      }
    }
  }
  return halves;
}

TEST(Fireflies, ThatBothHalvesCaughtAreToldByTheNoiseAbout) {
  Halves halves = NoisyHalves();
  SetBoth(5, 4, 1000, &halves);
  ASSERT_FALSE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  // Two deviations of a half of which every second pixel is black, over a quantile of 1.
  const float bound = 1 + 2 * std::sqrt(2.0f * 98 / 99);
  EXPECT_NEAR(halves.a[1].At(5, 4), bound, 1e-3f);
  EXPECT_NEAR(halves.b[1].At(5, 4), bound, 1e-3f);
  for (const auto& [dx, dy] : {std::pair(-2, 0), {2, 0}, {0, -2}, {0, 2}}) {
    Halves two = NoisyHalves();  // no longer by chance
    SetBoth(5, 4, 1000, &two);
    SetBoth(5 + dx, 4 + dy, 1000, &two);
    EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &two, nullptr)[0].empty()) << dx << "," << dy;
  }
}

TEST(Fireflies, AmongBlackPixelsAreCutToTwiceTheMeanOfTheOthers) {
  Halves halves = FlatHalves(11, 9, 0.0f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
  for (Plane& plane : halves.b) plane.At(6, 4) = 48.0f;  // 24 in X, so that the mean of 24 neighbours is 1
  ASSERT_FALSE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  EXPECT_NEAR(halves.a[0].At(5, 4), 2.0f, 1e-3f);
}

TEST(Fireflies, AreComparedWithTheMeanOfHalvesOfUnequalWeight) {
  Halves halves = FlatHalves(11, 9, 0.0f);
  halves.share_a.Fill(0.75f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
  for (Plane& plane : halves.b) plane.At(6, 4) = 48.0f;  // a quarter of it in X: the mean of 24 is 1/2
  ASSERT_FALSE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  EXPECT_NEAR(halves.a[0].At(5, 4), 1.0f, 1e-3f);
}

TEST(Fireflies, AreNotJudgedWithoutHalvesOrOutsideTheMask) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
  halves.weight_a.At(5, 4) = 0;
  EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  halves.weight_a.At(5, 4) = 1;
  halves.has_noise_estimate = false;
  EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
}

TEST(Fireflies, AreNotLookedForInDifferences) {
  Halves halves = FlatHalves(11, 9, 0.0f);
  halves.is_difference = true;
  for (int y = 0; y < 9; ++y) halves.a[1].At(5, y) = 1.0f;  // what an edge says, in a field of zeros
  EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  EXPECT_EQ(halves.a[1].At(5, 4), 1.0f);
}

TEST(Fireflies, AreNotLookedForWithinWhatNoiseAloneExceeds) {
  Halves halves = NoisyHalves();
  for (Plane& plane : halves.a) plane.At(5, 4) = 3.5f;
  EXPECT_TRUE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
  for (Plane& plane : halves.a) plane.At(5, 4) = 4.5f;
  EXPECT_FALSE(SuppressFireflies({}, kNoiseRadius, &halves, nullptr)[0].empty());
}

// What both halves lose of a picture of light 1, and what ReturnRemoved() gives back.

constexpr int kFireflyWidth = 128;
constexpr int kFireflyHeight = 96;
constexpr float kKnee = 0.2f;

struct Removed {
  Planes light = MakePlanes(3, kFireflyWidth, kFireflyHeight);
  Planes energy = MakePlanes(3, kFireflyWidth, kFireflyHeight);
  Planes geometry =
      MakePlanes(1, kFireflyWidth, kFireflyHeight);  // one plane of the same normal and distance

  Removed() {
    for (Plane& plane : light) plane.Fill(1);
  }
  void Add(int x, int y, float value) {
    for (Plane& plane : energy) plane.At(x, y) += value;
  }
  /// What a half gets.
  Planes Return(TaskPool* pool = nullptr) const {
    return std::move(ReturnTo({Clone(energy), Clone(energy)}, pool)[0]);
  }
  std::array<Planes, 2> ReturnTo(const std::array<Planes, 2>& lost, TaskPool* pool = nullptr) const {
    Halves halves = FlatHalves(kFireflyWidth, kFireflyHeight, 1.0f);
    halves.level = 1;
    return ReturnRemoved(lost, light, halves, geometry, kKnee, kFireflyReach, {}, pool);
  }
};

double Sum(const Plane& plane) {
  double sum = 0;
  ForEachPixel(plane.width(), plane.height(),
               [&](int x, int y) { sum += static_cast<double>(plane.At(x, y)); });
  return sum;
}

double Largest(const Plane& plane) {
  double largest = 0;
  ForEachPixel(plane.width(), plane.height(), [&](int x, int y) {
    largest = std::max(largest, std::abs(static_cast<double>(plane.At(x, y))));
  });
  return largest;
}

TEST(ReturnRemoved, ReturnsNothingOfOneOutlierWhereverItLies) {
  for (const float value : {500.0f, 3000.0f}) {
    for (const auto& [x, y] : {std::pair(60, 40), std::pair(0, 0), std::pair(kFireflyWidth - 1, 33)}) {
      Removed removed;
      removed.Add(x, y, value);
      EXPECT_LT(Largest(removed.Return()[1]), 1e-3) << value << " at " << x << " " << y;
    }
  }
}

TEST(ReturnRemoved, ReturnsNothingOfOneOutlierOnASmallSurface) {
  Removed removed;
  for (int y = 40; y < 46; ++y) {
    for (int x = 60; x < 66; ++x) removed.geometry[0].At(x, y) = 8;
  }
  removed.Add(62, 43, 3000);
  EXPECT_LT(Largest(removed.Return()[1]), 1e-3);
}

TEST(ReturnRemoved, ReturnsMostOfManyEqualOutliersWhereTheyAre) {
  Removed removed;
  for (int y = 2; y < kFireflyHeight; y += 5) {
    for (int x = 2; x < kFireflyWidth / 2; x += 5) removed.Add(x, y, 20);
  }
  for (Plane& plane : removed.light) {
    for (int y = 0; y < kFireflyHeight; ++y)
      std::fill(plane.Row(y) + kFireflyWidth / 2, plane.Row(y) + kFireflyWidth, 0.02f);
  }
  const Plane returned = std::move(removed.Return()[1]);
  double in_light = 0;
  for (int y = 0; y < kFireflyHeight; ++y) {
    for (int x = 0; x < kFireflyWidth / 2; ++x) in_light += static_cast<double>(returned.At(x, y));
  }
  EXPECT_GT(in_light, 0.9 * Sum(removed.energy[1]));
  EXPECT_LT(Sum(returned) - in_light, 0.01 * in_light);
}

TEST(ReturnRemoved, KeepsTheSumOfManyOutliers) {
  for (const uint32_t seed : {1u, 2u, 3u}) {
    Removed removed;
    std::mt19937 random(seed);
    for (int i = 0; i < 50; ++i)
      removed.Add(static_cast<int>(random() % kFireflyWidth), static_cast<int>(random() % kFireflyHeight),
                  30);
    EXPECT_NEAR(Sum(removed.Return()[1]) / Sum(removed.energy[1]), 1, 0.05) << seed;
  }
}

TEST(ReturnRemoved, GivesToEachHalfWhatItLostItself) {
  Removed removed;
  for (int i = 0; i < 30; ++i) removed.Add(4 * i + 3, 3 * i + 2, 30);
  const std::array<Planes, 2> returned =
      removed.ReturnTo({Clone(removed.energy), MakePlanes(3, kFireflyWidth, kFireflyHeight)});
  EXPECT_NEAR(Sum(returned[0][1]) / Sum(removed.energy[1]), 1, 0.1);
  EXPECT_EQ(Largest(returned[1][1]), 0);
}

TEST(ReturnRemoved, OutliersOfHalvesOfUnequalWeightAreAsManyAsTheyCount) {
  // One far from the other, each in one half: none returns anything nearby, and the layer gets the part
  // 1 - 1/n of what counts as n equal ones.
  std::array<Planes, 2> lost = {MakePlanes(3, kFireflyWidth, kFireflyHeight),
                                MakePlanes(3, kFireflyWidth, kFireflyHeight)};
  for (Plane& plane : lost[0]) plane.At(8, 48) = 1000;
  for (Plane& plane : lost[1]) plane.At(120, 48) = 1000;
  Halves halves = FlatHalves(kFireflyWidth, kFireflyHeight, 1.0f);
  halves.level = 1;
  const Removed flat;
  for (const float share : {0.5f, 0.9f, 0.1f}) {
    halves.share_a.Fill(share);
    const std::array<Planes, 2> returned =
        ReturnRemoved(lost, flat.light, halves, flat.geometry, kKnee, kFireflyReach, {}, nullptr);
    for (const Planes& half : returned)
      EXPECT_NEAR(Sum(half[1]) / 1000, 2 * static_cast<double>(share * (1 - share)), 0.02) << share;
  }
}

TEST(ReturnRemoved, GivesTheSameBitsForAnyPool) {
  Removed removed;
  for (int i = 0; i < 20; ++i) removed.Add(5 * i + 3, 4 * i + 2, 10);
  ShufflingPool pool(3);
  const Planes shuffled = removed.Return(&pool);
  const Planes alone = removed.Return();
  for (int y = 0; y < kFireflyHeight; ++y)
    EXPECT_TRUE(std::equal(alone[2].Row(y), alone[2].Row(y) + kFireflyWidth, shuffled[2].Row(y)));
}

TEST(MissingLight, OfAnOutlierDoesNotReturn) {
  // In units of 2, half A lost 2 of 4 in three pixels, of which a factor of 0.5 makes 2; half B lost nothing.
  constexpr int kPixels = 3;
  Halves halves;
  halves.scale = 2;
  for (Planes* half : {&halves.a, &halves.b}) {
    *half = MakePlanes(3, kPixels, 1);
    for (Plane& channel : *half) channel.Fill(2);
  }
  Planes rest = MakePlanes(3, kPixels, 1);
  std::array<Planes, 2> removed = {MakePlanes(3, kPixels, 1), MakePlanes(3, kPixels, 1)};
  Planes factor = MakePlanes(3, kPixels, 1);
  for (size_t c = 0; c < 3; ++c) {
    factor[c].Fill(0.5f);
    removed[0][c].Fill(2);
    rest[c].At(0, 0) = -0.5f;  // C has three quarters of the outlier,
    rest[c].At(1, 0) = -5;     // nothing of it,
    rest[c].At(2, 0) = 1;      // and all of it.
  }
  Product product;
  product.factor_of = {ViewOf(factor), ViewOf(factor)};
  product.rest_of = {ViewOf(rest), ViewOf(rest)};
  product.box = {0, 0, kPixels, 1};
  product.validity = MakePlane(kPixels, 1, 1);
  const std::array<Planes, 2> missing = TakeMissing(product, {}, halves, nullptr, &removed);
  ASSERT_EQ(missing[0].size(), 3u);
  EXPECT_EQ(missing[0][1].At(0, 0), 0.5f);
  EXPECT_EQ(missing[0][1].At(1, 0), 2.0f);
  EXPECT_EQ(missing[0][1].At(2, 0), 0.0f);
  EXPECT_EQ(removed[0][1].At(0, 0), 1.5f);
  EXPECT_EQ(removed[0][1].At(1, 0), 0.0f);
  EXPECT_EQ(removed[0][1].At(2, 0), 2.0f);
  EXPECT_EQ(missing[1][1].At(0, 0), 0.0f);
  // A pixel with a fragment of light 4 and factor 3 in half of it has 6 in C, and lost a half of that.
  LayerFragments fragments;
  fragments.pixels = {{1, 0, 0, 1}};
  fragments.factor = {{3, 3, 3}};
  for (size_t h = 0; h < 2; ++h) {
    fragments.share[h] = {0.5f};
    fragments.noisy[h] = {4, 4, 4};
  }
  removed[0][1].At(1, 0) = 2;
  EXPECT_EQ(TakeMissing(product, fragments, halves, nullptr, &removed)[0][1].At(1, 0), 3.0f);
  EXPECT_EQ(removed[0][1].At(1, 0), 0.0f);
}

}  // namespace
}  // namespace lumifold::filter
