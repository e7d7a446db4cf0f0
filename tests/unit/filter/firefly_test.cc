#include "filter/manifold/firefly.h"

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

}  // namespace
}  // namespace lumifold::filter
