#include "tests/charts/methods/rendering/irradiance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "filter/image/portable_math.h"

namespace lumifold::charts {
namespace {

using render::Frame;
using render::IndirectRadiance;
using scene::Vec3;

constexpr HemisphereStrata kFine = {64, 201};

/// One arrival from the middle of each stratum around `normal`, as `see` gives it for a direction.
template <typename See>
std::vector<IndirectRadiance> Arrivals(const HemisphereStrata& strata, Vec3 normal, See see) {
  const Frame frame = Frame::Of(normal);
  std::vector<IndirectRadiance> arrivals;
  arrivals.reserve(static_cast<size_t>(strata.count()));
  for (int i = 0; i < strata.count(); ++i)
    arrivals.push_back(see(frame.ToWorld(strata.Direction(i, {0.5f, 0.5f}))));
  return arrivals;
}

TEST(HemisphereStrata, AreAsManyAsAskedForOrNearly) {
  EXPECT_EQ(HemisphereStrata::OfRings(14).count(), 14 * 44);
  EXPECT_EQ(HemisphereStrata::OfRays(32).count(), 3 * 9);
  EXPECT_EQ(HemisphereStrata::OfRays(1).count(), 3);
}

TEST(HemisphereStrata, AreDrawnByTheCosine) {
  // The mean height of cosine-weighted directions is 2/3.
  double height = 0;
  for (int i = 0; i < kFine.count(); ++i) {
    const Vec3 direction = kFine.Direction(i, {0.5f, 0.5f});
    ASSERT_NEAR(Length(direction), 1, 1e-5);
    height += static_cast<double>(direction.z);
  }
  EXPECT_NEAR(height / kFine.count(), 2.0 / 3, 2e-4);
}

TEST(Irradiance, OfEvenLightIsPiTimesItAndHasNoSlope) {
  const Vec3 normal = scene::Normalize({1, 2, -2});
  const auto even = [](Vec3) { return IndirectRadiance{{2, 1, 0.5f}, 3}; };
  const Irradiance found = IrradianceFrom(HemisphereStrata::OfRings(14), normal,
                                          Arrivals(HemisphereStrata::OfRings(14), normal, even));
  EXPECT_NEAR(found.value.x, 2 * kPi, 1e-4);
  EXPECT_NEAR(found.value.z, 0.5f * kPi, 1e-4);
  EXPECT_NEAR(found.mean_distance, 3, 1e-4);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_LT(Length(found.by_turn[c]), 1e-3f);
    EXPECT_LT(Length(found.by_step[c]), 1e-3f);
  }
}

TEST(Irradiance, SeesNothingAtInfinity) {
  const auto nothing = [](Vec3) { return IndirectRadiance{}; };
  const HemisphereStrata strata = HemisphereStrata::OfRings(3);
  const Irradiance found = IrradianceFrom(strata, {0, 0, 1}, Arrivals(strata, {0, 0, 1}, nothing));
  EXPECT_EQ(found.value, Vec3{});
  EXPECT_TRUE(std::isinf(found.mean_distance));
  EXPECT_EQ(found.by_step[0], Vec3{});
}

TEST(Irradiance, GrowsAsTheNormalTurnsTowardsTheLight) {
  // Light 1 + a . direction gives the irradiance pi + 2/3 pi a . normal.
  const Vec3 a = {0.3f, -0.5f, 0.2f};
  const auto sky = [&](Vec3 direction) {
    const float light = 1 + Dot(a, direction);
    return IndirectRadiance{{light, 2 * light, 0}, 10};
  };
  for (const Vec3 normal : {Vec3{0, 0, 1}, scene::Normalize({1, 2, -2}), Vec3{0, -1, 0}}) {
    const Irradiance found = IrradianceFrom(kFine, normal, Arrivals(kFine, normal, sky));
    const Vec3 expected = (a - normal * Dot(a, normal)) * (2 * kPi / 3);
    EXPECT_LT(Length(found.by_turn[0] - expected), 0.02f);
    EXPECT_LT(Length(found.by_turn[1] - expected * 2), 0.04f);
    EXPECT_EQ(found.by_turn[2], Vec3{});
  }
}

/// The irradiance at `from`, facing up (+Z), from the square [-1, 1]^2 at height 1 that radiates 1; sum over
/// edges (Lambert 1760).
double UnderSquare(Vec3 from) {
  const std::vector<Vec3> corners = {{-1, -1, 1}, {-1, 1, 1}, {1, 1, 1}, {1, -1, 1}};
  double sum = 0;
  for (size_t i = 0; i < 4; ++i) {
    const Vec3 a = scene::Normalize(corners[i] - from);
    const Vec3 b = scene::Normalize(corners[(i + 1) % 4] - from);
    const Vec3 across = Cross(a, b);
    sum -= std::atan2(Length(across), Dot(a, b)) * static_cast<double>(across.z / Length(across));
  }
  return 0.5 * sum;
}

TEST(Irradiance, GrowsAsThePlaceComesCloserToALamp) {
  for (const Vec3 from : {Vec3{0.5f, 0, 0}, Vec3{1.5f, 0.4f, 0}, Vec3{-0.8f, -1.2f, 0}}) {
    const auto lamp = [&](Vec3 direction) {
      if (direction.z <= 0) return IndirectRadiance{};
      const Vec3 hit = from + direction * (1 / direction.z);
      if (std::abs(hit.x) > 1 || std::abs(hit.y) > 1) return IndirectRadiance{};
      return IndirectRadiance{{1, 1, 1}, 1 / direction.z};
    };
    const Irradiance found = IrradianceFrom(kFine, {0, 0, 1}, Arrivals(kFine, {0, 0, 1}, lamp));
    EXPECT_NEAR(found.value.x / UnderSquare(from), 1, 0.02);
    constexpr float kStep = 0.01f;
    const Vec3 expected = {
        static_cast<float>((UnderSquare(from + Vec3{kStep, 0, 0}) - UnderSquare(from - Vec3{kStep, 0, 0})) /
                           (2 * kStep)),
        static_cast<float>((UnderSquare(from + Vec3{0, kStep, 0}) - UnderSquare(from - Vec3{0, kStep, 0})) /
                           (2 * kStep)),
        0};
    EXPECT_LT(Length(found.by_step[0] - expected), 0.1f * Length(expected)) << from.x;
  }
}

}  // namespace
}  // namespace lumifold::charts
