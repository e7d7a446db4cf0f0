#include "filter/denoise/firefly.h"

#include <gtest/gtest.h>

namespace lumifold::filter {
namespace {

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

TEST(Fireflies, AreCutToTheBoundAndWhatTheyLoseIsKept) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
  const Planes removed = SuppressFireflies(&halves, nullptr);
  ASSERT_EQ(removed.size(), 3u);
  EXPECT_NEAR(halves.a[0].At(5, 4), 2.0f, 1e-3f);
  EXPECT_EQ(halves.b[0].At(5, 4), 1.0f);
  EXPECT_NEAR(removed[0].At(5, 4), 0.5f * 998.0f, 1e-2f);
  EXPECT_EQ(removed[0].At(4, 4), 0.0f);
}

TEST(Fireflies, BrightPixelsThatBothHalvesSeeStay) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  for (Planes* half : {&halves.a, &halves.b}) {
    for (Plane& plane : *half) plane.At(5, 4) = 1000.0f;
  }
  EXPECT_TRUE(SuppressFireflies(&halves, nullptr).empty());
  EXPECT_EQ(halves.a[1].At(5, 4), 1000.0f);
}

/// Halves of which every second pixel has nothing in one of them, about `bright` pixels that both see.
Halves NoisyHalves(int bright) {
  Halves halves = FlatHalves(11, 9, 0.0f);
  for (Planes* half : {&halves.a, &halves.b}) {
    for (Plane& plane : *half) {
      for (int y = 0; y < 9; ++y) {
        for (int x = 0; x < 11; ++x)
          plane.At(x, y) = (x + y) % 2 == (half == &halves.a ? 0 : 1) ? 2.0f : 0.0f;
      }
      for (int i = 0; i < bright; ++i) plane.At(5 + i, 4) = 1000.0f;
    }
  }
  return halves;
}

TEST(Fireflies, ThatBothHalvesCaughtAreToldByTheNoiseAbout) {
  Halves halves = NoisyHalves(1);
  ASSERT_FALSE(SuppressFireflies(&halves, nullptr).empty());
  EXPECT_NEAR(halves.a[1].At(5, 4), 2.0f, 1e-3f);
  EXPECT_NEAR(halves.b[1].At(5, 4), 2.0f, 1e-3f);
  Halves two = NoisyHalves(2);  // no longer by chance
  EXPECT_TRUE(SuppressFireflies(&two, nullptr).empty());
}

TEST(Fireflies, AreNotJudgedWithoutHalvesOrOutsideTheMask) {
  Halves halves = FlatHalves(11, 9, 1.0f);
  for (Plane& plane : halves.a) plane.At(5, 4) = 1000.0f;
  halves.weight_a.At(5, 4) = 0;
  EXPECT_TRUE(SuppressFireflies(&halves, nullptr).empty());
  halves.weight_a.At(5, 4) = 1;
  halves.has_noise_estimate = false;
  EXPECT_TRUE(SuppressFireflies(&halves, nullptr).empty());
}

TEST(Fireflies, AreNotLookedForInDifferences) {
  Halves halves = FlatHalves(11, 9, 0.0f);
  halves.is_difference = true;
  for (int y = 0; y < 9; ++y) halves.a[1].At(5, y) = 1.0f;  // what an edge says, in a field of zeros
  EXPECT_TRUE(SuppressFireflies(&halves, nullptr).empty());
  EXPECT_EQ(halves.a[1].At(5, 4), 1.0f);
}

TEST(Fireflies, WhatTheyLoseIsSpreadOverWhatIsLitAlike) {
  constexpr int kWidth = 48;
  constexpr int kHeight = 24;
  Planes removed = MakePlanes(3, kWidth, kHeight);
  removed[0].At(20, 12) = 100.0f;
  Planes light = MakePlanes(3, kWidth, kHeight);
  for (Plane& plane : light) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) plane.At(x, y) = x < kWidth / 2 ? 6.0f : 0.0f;
    }
  }
  Planes geometry;
  geometry.push_back(Plane(kWidth, kHeight));  // one plane of the same normal and distance
  Plane weight(kWidth, kHeight);
  weight.Fill(1);
  const Planes spread = SpreadRemoved(removed, light, geometry, weight.view(), nullptr);
  float in_light = 0;
  float in_dark = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) (x < kWidth / 2 ? in_light : in_dark) += spread[0].At(x, y);
  }
  EXPECT_GT(in_light, 50.0f);
  EXPECT_LT(in_dark, 0.1f);
}

}  // namespace
}  // namespace lumifold::filter
