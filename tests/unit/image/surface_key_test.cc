#include "filter/image/surface_key.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <set>

namespace lumifold {
namespace {

constexpr std::array<float, 3> kUp = {0, 1, 0};

TEST(SurfaceKey, IsAWholeNumberThatAFloatHolds) {
  std::set<float> keys;
  for (int id = 1; id <= 1000; ++id) {
    for (const std::array<float, 3>& normal : {kUp, {0, -1, 0}, {1, 0, 0}, {0, 0, -1}}) {
      const float key = SurfaceKey(static_cast<float>(id), normal, 7);
      EXPECT_GE(key, 1);
      EXPECT_LT(key, 0x1p24f);
      EXPECT_EQ(key, std::floor(key));
      keys.insert(key);
    }
  }
  EXPECT_GE(keys.size(), 3995u) << "of 4000 names";
}

TEST(SurfaceKey, KeepsASurfaceTogether) {
  const float key = SurfaceKey(3, kUp, 2.1f);
  EXPECT_EQ(SurfaceKey(3, {0.5f, 0.8f, -0.3f}, 2.15f), key);
  EXPECT_NE(SurfaceKey(4, kUp, 2.1f), key) << "another object";
  EXPECT_NE(SurfaceKey(3, {0, -1, 0}, 2.1f), key) << "another side";
  EXPECT_NE(SurfaceKey(3, {0.8f, 0.5f, -0.3f}, 2.1f), key) << "another axis";
  EXPECT_EQ(SurfaceKey(3, kUp, 2300.0f), key) << "in any unit of length";
}

TEST(SurfaceKey, IsZeroWhereNoSurfaceIs) {
  EXPECT_EQ(SurfaceKey(0, kUp, 1), 0);
  EXPECT_EQ(SurfaceKey(NAN, kUp, 1), 0);
  EXPECT_EQ(SurfaceKey(INFINITY, kUp, 1), 0);
  EXPECT_EQ(SurfaceKey(1, {0, NAN, 0}, 1), 0);
  EXPECT_EQ(SurfaceKey(1, kUp, NAN), 0);
  EXPECT_EQ(SurfaceKey(1, kUp, 0), 0);
  EXPECT_EQ(SurfaceKey(1, kUp, -1), 0);
  EXPECT_EQ(SurfaceKey(1, kUp, INFINITY), 0);
  EXPECT_GT(SurfaceKey(1, {0, 0, 0}, 1e-45f), 0) << "the smallest distance";
}

// Fragments of units, films and files hold these numbers: they never change.
TEST(SurfaceKey, HasTheSameBitsEverywhere) {
  EXPECT_EQ(SurfaceKey(1, {0, 0, 1}, 1.0f), 5863965);
  EXPECT_EQ(SurfaceKey(12, {-0.9f, 0.1f, 0.3f}, 0.05f), 13433524);
  EXPECT_EQ(SurfaceKey(70000, {0.1f, -0.6f, 0.5f}, 1234.5f), 239221);
}

}  // namespace
}  // namespace lumifold
