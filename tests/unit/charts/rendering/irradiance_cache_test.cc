#include "tests/charts/methods/rendering/irradiance_cache.h"

#include <gtest/gtest.h>

#include <optional>

namespace lumifold::charts {
namespace {

using scene::Vec3;

constexpr float kAccuracy = 0.2f;
constexpr scene::Bounds kBounds = {{-1, -1, -1}, {1, 1, 1}};

IrradianceRecord RecordAt(Vec3 position, Vec3 normal, float value, float radius = 1) {
  IrradianceRecord record = {position, normal, {}, radius, 1e-3f};
  record.irradiance.value = {value, 2 * value, 3 * value};
  return record;
}

TEST(IrradianceCache, KnowsNothingAtFirst) {
  EXPECT_FALSE(IrradianceCache(kBounds, kAccuracy).Look({0, 0, 0}, {0, 0, 1}, 1).has_value());
  EXPECT_FALSE(IrradianceCache(scene::Bounds{}, kAccuracy).Look({0, 0, 0}, {0, 0, 1}, 2).has_value());
}

TEST(IrradianceCache, GivesEvenIrradianceBackAsItIs) {
  IrradianceCache cache(kBounds, kAccuracy);
  for (int i = -6; i <= 6; ++i) {
    for (int j = -6; j <= 6; ++j)
      cache.Insert(RecordAt({static_cast<float>(i) * 0.15f, static_cast<float>(j) * 0.15f, 0}, {0, 0, 1}, 4));
  }
  for (int i = -13; i <= 13; ++i) {
    for (int j = -13; j <= 13; ++j) {
      const float x = 0.07f * static_cast<float>(i);
      const float y = 0.07f * static_cast<float>(j);
      const std::optional<Vec3> found = cache.Look({x, y, 0}, {0, 0, 1}, 1);
      ASSERT_TRUE(found.has_value()) << x << " " << y;
      EXPECT_NEAR(found->x, 4, 1e-5);
      EXPECT_NEAR(found->z, 12, 1e-5);
    }
  }
}

TEST(IrradianceCache, FollowsTheGradients) {
  IrradianceCache cache(kBounds, kAccuracy);
  IrradianceRecord record = RecordAt({0.1f, 0, 0}, {0, 0, 1}, 4);
  record.irradiance.by_step[0] = {10, 0, 0};
  record.irradiance.by_turn[1] = {0, 5, 0};
  cache.Insert(record);
  EXPECT_NEAR(cache.Look({0.2f, 0, 0}, {0, 0, 1}, 1)->x, 5, 1e-5);
  EXPECT_NEAR(cache.Look({0.1f, 0, 0}, scene::Normalize({0, 0.02f, 1}), 1)->y, 8.1f, 1e-4);
}

TEST(IrradianceCache, NeverGoesBelowZero) {
  IrradianceCache cache(kBounds, kAccuracy);
  IrradianceRecord record = RecordAt({0, 0, 0}, {0, 0, 1}, 1);
  record.irradiance.by_step[0] = {-100, 0, 0};
  cache.Insert(record);
  EXPECT_EQ(cache.Look({0.1f, 0, 0}, {0, 0, 1}, 1)->x, 0);
}

TEST(IrradianceCache, EndsWhereTheAccuracySays) {
  IrradianceCache cache(kBounds, kAccuracy);
  cache.Insert(RecordAt({0, 0, 0}, {0, 0, 1}, 1, 0.5f));
  EXPECT_TRUE(cache.Look({0.099f, 0, 0}, {0, 0, 1}, 1).has_value());
  EXPECT_FALSE(cache.Look({0.101f, 0, 0}, {0, 0, 1}, 1).has_value());
  EXPECT_TRUE(cache.Look({0.199f, 0, 0}, {0, 0, 1}, 2).has_value());
}

TEST(IrradianceCache, DoesNotLeakThroughAWallOrRoundACorner) {
  IrradianceCache cache(kBounds, 1);
  cache.Insert(RecordAt({0, 0, 0}, {0, 0, 1}, 1));
  EXPECT_FALSE(cache.Look({0, 0, -1e-3f}, {0, 0, -1}, 1).has_value()) << "the wall's other side";
  EXPECT_FALSE(cache.Look({0, 0, -0.1f}, {0, 0, 1}, 1).has_value()) << "a step lower";
  EXPECT_FALSE(cache.Look({0.1f, 0, 0.1f}, {1, 0, 0}, 1).has_value()) << "a wall that meets the floor";
  EXPECT_TRUE(cache.Look({0.1f, 0, 0}, {0, 0, 1}, 1).has_value());
}

TEST(IrradianceCache, ClampsNeighboursByEachOther) {
  IrradianceCache cache(kBounds, kAccuracy);
  cache.Insert(RecordAt({0, 0, 0}, {0, 0, 1}, 1, 1));
  cache.Insert(RecordAt({0.2f, 0, 0}, {0, 0, 1}, 2, 0.1f));
  // The first record's radius is now 0.2 + 0.1, so that it is used up to 0.06.
  EXPECT_TRUE(cache.Look({0, 0.059f, 0}, {0, 0, 1}, 1).has_value());
  EXPECT_FALSE(cache.Look({0, 0.061f, 0}, {0, 0, 1}, 1).has_value());
  // A new record next to the small one is clamped by it: 0.1 + 0.1.
  cache.Insert(RecordAt({0.2f, -0.1f, 0}, {0, 0, 1}, 3, 5));
  EXPECT_TRUE(cache.Look({0.2f, -0.139f, 0}, {0, 0, 1}, 1).has_value());
  EXPECT_FALSE(cache.Look({0.2f, -0.141f, 0}, {0, 0, 1}, 1).has_value());
}

TEST(IrradianceCache, KeepsTheLeastRadiusAgainstNeighbours) {
  IrradianceCache cache(kBounds, kAccuracy);
  IrradianceRecord record = RecordAt({0, 0, 0}, {0, 0, 1}, 1, 1);
  record.least_radius = 0.5f;
  cache.Insert(record);
  cache.Insert(RecordAt({0.01f, 0, 0}, {0, 0, 1}, 1, 0.01f));
  EXPECT_TRUE(cache.Look({0, 0.09f, 0}, {0, 0, 1}, 1).has_value());
}

}  // namespace
}  // namespace lumifold::charts
