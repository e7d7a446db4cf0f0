#include "filter/manifold/first_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "filter/manifold/manifold_filter.h"
#include "is_finite.h"
#include "tests/unit/filter/manifold_oracle.h"

namespace lumifold::filter {
namespace {

constexpr int kFirstOrderWidth = 64;
constexpr int kFirstOrderHeight = 48;
constexpr float kFirstOrderReach = 7;

/// Light that rises to the right and down, of another slope in each channel.
float Rising(size_t channel, int x, int y) {
  return 1.0f + 0.02f * static_cast<float>(x) * static_cast<float>(channel + 1) +
         0.03f * static_cast<float>(y);
}

Planes RisingLight() {
  Planes light = MakePlanes(3, kFirstOrderWidth, kFirstOrderHeight);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < kFirstOrderHeight; ++y) {
      for (int x = 0; x < kFirstOrderWidth; ++x) light[c].At(x, y) = Rising(c, x, y);
    }
  }
  return light;
}

/// One surface alike everywhere.
struct Scene {
  Planes features = MakePlanes(1, kFirstOrderWidth, kFirstOrderHeight);
  Plane mask = Plane(kFirstOrderWidth, kFirstOrderHeight);
  Scene() { mask.Fill(1); }
};

constexpr ManifoldParams kFit = {.sigma_s = kFirstOrderReach, .height = 3, .cell = 4, .is_first_order = true};

Planes FirstOrder(const Planes& light, const Scene& scene, const ManifoldParams& params) {
  return ManifoldFilter(light, scene.features, scene.mask.view(), params, nullptr);
}

/// Light and its moments over pixels: what the oracle takes for signals.
Planes MomentsOf(const Planes& light) {
  Planes moments = MakePlanes(kMoments, kFirstOrderWidth, kFirstOrderHeight);
  for (int row = 0; row < kFirstOrderHeight; ++row) {
    for (int column = 0; column < kFirstOrderWidth; ++column) {
      const float x = (static_cast<float>(column) - 0.5f * (kFirstOrderWidth - 1)) / kFirstOrderReach;
      const float y = (static_cast<float>(row) - 0.5f * (kFirstOrderHeight - 1)) / kFirstOrderReach;
      std::vector<float> values = {1, 1, 1, x, y, x, x, x, y, y, y, x * x, x * y, y * y};
      for (size_t k : {0u, 1u, 2u, 5u, 6u, 7u, 8u, 9u, 10u})
        values[k] *= light[k < 3 ? k : (k - 5) % 3].At(column, row);
      for (size_t k = 0; k < kMoments; ++k) moments[k].At(column, row) = values[k];
    }
  }
  return moments;
}

/// FitLight at the pixels of a picture.
Planes Fitted(const Planes& means, float unit_px, float ridge) {
  const Planes places = Positions(means[0].width(), means[0].height(), unit_px);
  return FitLight(means, places[0], places[1], ridge, nullptr);
}

TEST(FirstOrder, EqualsItsOracleOnCellsOfAPixel) {
  Scene scene;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  Planes light = RisingLight();
  for (int y = 0; y < kFirstOrderHeight; ++y) {
    for (int x = 0; x < kFirstOrderWidth; ++x) {
      scene.features[0].At(x, y) = x + y < 50 ? 0.0f : 0.8f + 0.5f * uniform(random);
      scene.mask.At(x, y) = uniform(random) < 0.1f ? 0.0f : 1.0f;
      for (Plane& channel : light) channel.At(x, y) += uniform(random);
    }
  }
  ManifoldParams fit = kFit;
  fit.cell = 1;
  ManifoldParams plain = fit;
  plain.is_first_order = false;
  const Planes means = ManifoldFilterOracle(MomentsOf(light), scene.features, scene.mask.view(), plain,
                                            kFirstOrderReach, nullptr)
                           .filtered;
  const Planes expected = Fitted(means, kFirstOrderReach, kFit.slope_ridge);
  const Planes fast = FirstOrder(light, scene, fit);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < kFirstOrderHeight; ++y) {
      for (int x = 0; x < kFirstOrderWidth; ++x)
        ASSERT_NEAR(fast[c].At(x, y), expected[c].At(x, y), 2e-3f) << c << ": " << x << "," << y;
    }
  }
}

TEST(FirstOrder, KeepsAPlaneUpToThePicturesBorder) {
  const Scene scene;
  const Planes light = RisingLight();
  ManifoldParams plain = kFit;
  plain.is_first_order = false;
  const Planes mean = FirstOrder(light, scene, plain);
  const Planes fitted = FirstOrder(light, scene, kFit);
  EXPECT_GT(std::abs(mean[2].At(0, 0) - Rising(2, 0, 0)), 0.2f);  // what a mean is wrong by there
  for (size_t c = 0; c < 3; ++c) {
    for (const auto& [x, y] :
         {std::pair{0, 0}, {kFirstOrderWidth - 1, 0}, {5, kFirstOrderHeight - 1}, {30, 20}})
      EXPECT_NEAR(fitted[c].At(x, y), Rising(c, x, y), 0.05f) << c << ": " << x << "," << y;
  }
}

TEST(FirstOrder, KeepsAPlaneHoweverPixelsLieInTheirCells) {
  Scene scene;
  std::mt19937 random(5);
  for (int y = 0; y < kFirstOrderHeight; ++y) {
    for (int x = 0; x < kFirstOrderWidth; ++x) {
      scene.mask.At(x, y) = random() % 3 == 0 ? 1.0f : 0.0f;
      scene.features[0].At(x, y) = 0.01f * static_cast<float>(x);
    }
  }
  const Planes fitted = FirstOrder(RisingLight(), scene, kFit);
  for (int y = 0; y < kFirstOrderHeight; ++y) {
    for (int x = 0; x < kFirstOrderWidth; ++x)
      EXPECT_NEAR(fitted[2].At(x, y), Rising(2, x, y), 0.06f) << x << "," << y;
  }
}

TEST(FirstOrder, KeepsAConstant) {
  const Scene scene;
  Planes light = MakePlanes(3, kFirstOrderWidth, kFirstOrderHeight);
  for (Plane& channel : light) channel.Fill(0.7f);
  const Planes fitted = FirstOrder(light, scene, kFit);
  for (int x = 0; x < kFirstOrderWidth; ++x) EXPECT_NEAR(fitted[1].At(x, 3), 0.7f, 1e-4f);
}

TEST(FirstOrder, TakesThePixelsOwnLightWhereTheFilterFoundNothing) {
  Scene scene;
  scene.mask.Fill(0);
  const Planes light = RisingLight();
  const Planes fitted = FirstOrder(light, scene, kFit);
  for (int x = 0; x < kFirstOrderWidth; ++x) EXPECT_EQ(fitted[1].At(x, 7), light[1].At(x, 7));
}

TEST(FirstOrder, StaysFiniteBesideWeightsBelowNormalNumbers) {
  Scene scene;
  for (int y = 0; y < kFirstOrderHeight; ++y) {
    for (int x = kFirstOrderWidth / 2; x < kFirstOrderWidth; ++x) scene.mask.At(x, y) = 1e-42f;
  }
  EXPECT_TRUE(IsFinite(FirstOrder(RisingLight(), scene, kFit)));
}

TEST(FitLight, StaysFiniteWhereRoundingMakesSpreadsNegative) {
  Planes means = MomentsOf(RisingLight());
  for (size_t k : {11u, 13u}) {
    for (int y = 0; y < kFirstOrderHeight; ++y) {
      for (int x = 0; x < kFirstOrderWidth; ++x) means[k].At(x, y) -= 0.01f;
    }
  }
  const Planes fitted = Fitted(means, kFirstOrderReach, kFit.slope_ridge);
  for (int x = 0; x < kFirstOrderWidth; ++x) EXPECT_NEAR(fitted[0].At(x, 3), Rising(0, x, 3), 1e-3f);
}

TEST(FirstOrder, FindsAtPointsWhatThePixelsFind) {
  const Scene scene;
  SlicePoints points;
  points.pixels = {{0, 0}, {40, 30}};
  points.own_features = 1;
  points.features.assign(2, 0.0f);
  const ManifoldResult result = ManifoldFilterAtPoints(RisingLight(), scene.features, scene.mask.view(), kFit,
                                                       kFirstOrderReach, &points, nullptr);
  ASSERT_EQ(result.points.values.size(), 6u);
  for (size_t i = 0; i < 2; ++i) {
    const auto [x, y] = points.pixels[i];
    for (size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(result.points.values[3 * i + c], result.filtered[c].At(x, y), 1e-3f) << i << " " << c;
  }
}

TEST(FirstOrder, KeepsAPlaneInTheLongestBlock) {
  constexpr int kLong = 4096;  // BlockParams::longest
  Planes light = MakePlanes(3, kLong, 8);
  for (Plane& channel : light) {
    ForEachPixel(kLong, 8, [&](int x, int y) {
      channel.At(x, y) = 1.0f + 0.02f * static_cast<float>(x) + 0.01f * static_cast<float>(y);
    });
  }
  const Planes filtered =
      ManifoldFilter(light, MakePlanes(1, kLong, 8), MakePlane(kLong, 8, 1.0f).view(), kFit, nullptr);
  ForEachPixel(kLong, 8, [&](int x, int y) {
    // At the border the ridge bends the plane by as much in a short block.
    ASSERT_NEAR(filtered[1].At(x, y), light[1].At(x, y), 1e-2f) << x << " " << y;
  });
}

/// Means over samples around (5, 0) of light that is x: the pixel of a picture of one is at (0, 0).
TEST(FirstOrder, ReadsNoPlaneFarBeyondItsSamples) {
  constexpr float kRidge = 0.01f;
  for (const auto& [variance, expected] :
       {std::pair(9.0f, 0.0f), std::pair(0.09f, 5 - 3 * std::sqrt(0.1f) * 0.9f)}) {
    Planes means = MakePlanes(kMoments, 1, 1);
    for (const size_t k : {0u, 1u, 2u, 3u}) means[k].Fill(5);               // light, x
    for (const size_t k : {5u, 6u, 7u, 11u}) means[k].Fill(25 + variance);  // x times light, x^2
    const Planes light = Fitted(means, 1, kRidge);
    EXPECT_NEAR(light[0].At(0, 0), expected, 1e-2f) << variance;
    EXPECT_EQ(light[2].At(0, 0), light[0].At(0, 0));
  }
}

}  // namespace
}  // namespace lumifold::filter
