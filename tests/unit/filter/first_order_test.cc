#include "filter/manifold/first_order.h"

#include <gtest/gtest.h>

#include <cmath>

#include "filter/manifold/layer_filter.h"

namespace lumifold::filter {
namespace {

constexpr int kWidth = 64;
constexpr int kHeight = 48;
constexpr float kUnit = 16;

/// Light that rises to the right and down, of another slope in each channel.
float Rising(size_t channel, int x, int y) {
  return 1.0f + 0.02f * static_cast<float>(x) * static_cast<float>(channel + 1) +
         0.03f * static_cast<float>(y);
}

Planes RisingLight() {
  Planes light = MakePlanes(3, kWidth, kHeight);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) light[c].At(x, y) = Rising(c, x, y);
    }
  }
  return light;
}

/// One surface alike everywhere.
struct Scene {
  Planes features = MakePlanes(1, kWidth, kHeight);
  Plane mask = Plane(kWidth, kHeight);
  Scene() { mask.Fill(1); }
};

Planes Filtered(const Planes& signals, const Scene& scene) {
  return ManifoldFilter(signals, scene.features, scene.mask.view(), {.sigma_s = 7, .height = 3, .cell = 4},
                        nullptr);
}

TEST(FitLight, KeepsAPlaneUpToThePicturesBorder) {
  const Scene scene;
  const Planes light = RisingLight();
  const Planes mean = Filtered(light, scene);
  const Planes fitted = FitLight(Filtered(WithMoments(light, kUnit, nullptr), scene), kUnit, nullptr);
  EXPECT_GT(std::abs(mean[2].At(0, 0) - Rising(2, 0, 0)), 0.2f);  // what a mean is wrong by there
  for (size_t c = 0; c < 3; ++c) {
    for (const auto& [x, y] : {std::pair{0, 0}, {kWidth - 1, 0}, {5, kHeight - 1}, {30, 20}})
      EXPECT_NEAR(fitted[c].At(x, y), Rising(c, x, y), 0.05f) << c << ": " << x << "," << y;
  }
}

TEST(FitLight, TakesThePixelsOwnLightWhereTheFilterFoundNothing) {
  const Planes light = RisingLight();
  const Planes fitted = FitLight(WithMoments(light, kUnit, nullptr), kUnit, nullptr);
  for (int x = 0; x < kWidth; ++x) EXPECT_NEAR(fitted[1].At(x, 7), Rising(1, x, 7), 1e-5f);
}

TEST(FitLight, StaysFiniteWhereRoundingMakesSpreadsNegative) {
  Planes means = WithMoments(RisingLight(), kUnit, nullptr);
  for (size_t k : {11u, 13u}) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) means[k].At(x, y) -= 0.01f;
    }
  }
  const Planes fitted = FitLight(means, kUnit, nullptr);
  for (int x = 0; x < kWidth; ++x) EXPECT_NEAR(fitted[0].At(x, 3), Rising(0, x, 3), 1e-3f);
}

TEST(FitLightAtPoints, FindsWhatThePixelsFind) {
  const Scene scene;
  const Planes moments = WithMoments(RisingLight(), kUnit, nullptr);
  SlicePoints points;
  points.samples = 2;
  points.pixels = {{0, 0}, {40, 30}};
  points.own_features = 1;
  points.features.assign(4, 0.0f);
  ManifoldResult result =
      ManifoldFilterAtPoints(moments, scene.features, scene.mask.view(),
                             {.sigma_s = 7, .height = 3, .cell = 4}, 7.0f, &points, nullptr);
  const Planes fitted = FitLight(result.filtered, kUnit, nullptr);
  const SlicedPoints found = FitLightAtPoints(points, result.points, kUnit, kWidth, kHeight);
  ASSERT_EQ(found.values.size(), 12u);
  for (size_t i = 0; i < 2; ++i) {
    const auto [x, y] = points.pixels[i];
    for (size_t c = 0; c < 3; ++c) {
      for (size_t j = 0; j < 2; ++j)
        EXPECT_NEAR(found.values[(i * 3 + c) * 2 + j], fitted[c].At(x, y), 1e-3f) << i << " " << c;
    }
  }
}

}  // namespace
}  // namespace lumifold::filter
