#include "worker/scene/keyframes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace lumifold::scene {
namespace {

using testing::ElementsAre;
using testing::FloatNear;

Vec4 TurnAboutZ(double angle) {
  return {0, 0, static_cast<float>(std::sin(angle / 2)), static_cast<float>(std::cos(angle / 2))};
}

TEST(Keyframes, AreClampedBeforeTheFirstAndAfterTheLast) {
  const std::vector<float> times = {1, 2, 4};
  for (const double time : {-5.0, 0.0, 0.999}) EXPECT_EQ(FindKeyframes(times, time).right, 0u) << time;
  for (const double time : {4.0, 4.5, 1e30}) {
    const KeyframeSpan span = FindKeyframes(times, time);
    EXPECT_EQ(span.left, 2u) << time;
    EXPECT_EQ(span.right, 2u) << time;
  }
}

TEST(Keyframes, AreFoundOnBothSidesOfATime) {
  const KeyframeSpan span = FindKeyframes({1, 2, 4}, 3.5);
  EXPECT_EQ(span.left, 1u);
  EXPECT_EQ(span.right, 2u);
  EXPECT_EQ(span.fraction, 0.75f);
  EXPECT_EQ(span.seconds, 2.0f);
  EXPECT_EQ(FindKeyframes({1, 2, 4}, 2).left, 1u);
  EXPECT_EQ(FindKeyframes({1, 2, 4}, 2).fraction, 0.0f);
}

TEST(Keyframes, WithEqualTimesUseTheLaterOne) {
  const KeyframeSpan span = FindKeyframes({0, 1, 1, 2}, 1);
  EXPECT_EQ(span.left, 2u);
  EXPECT_EQ(span.fraction, 0.0f);
}

TEST(Keyframes, BlendLinearly) {
  const std::vector<float> left = {0, 10}, right = {4, 20};
  EXPECT_THAT(LinearBetween(left, right, 0.25f), ElementsAre(1, 12.5f));
}

TEST(Keyframes, RotateAtConstantSpeed) {
  for (const double angle : {1e-4, 0.01, 0.03, 0.5, 2.0, 3.0}) {
    for (const float fraction : {0.0f, 0.1f, 0.5f, 0.9f, 1.0f}) {
      const Vec4 q = SphericalBetween(TurnAboutZ(0), TurnAboutZ(angle), fraction);
      EXPECT_NEAR(2 * std::atan2(q.z, q.w), angle * double{fraction}, 3e-6) << angle << " " << fraction;
      EXPECT_NEAR(q.z * q.z + q.w * q.w, 1, 1e-6);
    }
  }
}

TEST(Keyframes, RotateAlongTheShorterArc) {
  const Vec4 turned = TurnAboutZ(1);
  const Vec4 q = SphericalBetween(TurnAboutZ(0), {-turned.x, -turned.y, -turned.z, -turned.w}, 0.5f);
  EXPECT_NEAR(2 * std::atan2(q.z, q.w), 0.5, 1e-6);
}

TEST(Keyframes, FollowACubicThroughValuesAndTangents) {
  // p(t) = t^3 - 2t over two seconds from t = 1: a cubic is its own Hermite interpolant.
  const auto p = [](double t) { return static_cast<float>(t * t * t - 2 * t); };
  const auto slope = [](double t) { return static_cast<float>(3 * t * t - 2); };
  const std::vector<float> left = {p(1)}, right = {p(3)}, out = {slope(1)}, in = {slope(3)};
  for (const float fraction : {0.0f, 0.25f, 0.5f, 0.75f}) {
    const KeyframeSpan span = {0, 1, fraction, 2};
    EXPECT_THAT(CubicBetween(span, left, out, in, right),
                ElementsAre(FloatNear(p(1 + 2 * double{fraction}), 1e-5f)));
  }
}

TEST(Keyframes, NormaliseQuaternionsOfAnyLength) {
  for (const float size : {1e-30f, 1.0f, 1e30f}) {
    const Vec4 q = UnitQuaternion({0, 3 * size, 0, 4 * size});
    EXPECT_NEAR(q.y, 0.6, 1e-6);
    EXPECT_NEAR(q.w, 0.8, 1e-6);
  }
  EXPECT_EQ(UnitQuaternion({0, 0, 0, 0}).w, 0);
}

}  // namespace
}  // namespace lumifold::scene
