#include "filter/edges/light_regression.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/are_equal.h"
#include "tests/unit/filter/manifold_oracle.h"

namespace lumifold::filter {
namespace {

constexpr int kRegressionWidth = 32;
constexpr int kRegressionHeight = 30;
constexpr int kEdge = 16;                 // the column of pixels that show both surfaces
constexpr float kRegressionNoise = 0.3f;  // deviation of a half
constexpr float kCovered = 0.5f;          // by each surface in them
constexpr float kLightKnee = 0.2f;
constexpr int kUnsampledRow = 11;  // where half A has no sample of the right surface

/// Light of the left (0) and right (1) surface.
float TrueLight(int surface, int y) { return surface == 0 ? 1 + 0.02f * static_cast<float>(y) : 4.0f; }

/// A layer of two surfaces, and F, which is too bright by a quarter on the edge.
struct Layer {
  Halves halves;
  LayerFragments fragments;
  Planes geometry;
  Candidate filtered;
};

Layer TwoSurfaces(float unit) {
  Layer layer;
  Halves& halves = layer.halves;
  halves.a = MakePlanes(3, kRegressionWidth, kRegressionHeight);
  halves.b = MakePlanes(3, kRegressionWidth, kRegressionHeight);
  for (Plane* plane : {&halves.weight_a, &halves.weight_b, &halves.weight})
    *plane = MakePlane(kRegressionWidth, kRegressionHeight, 1.0f);
  halves.is_mixed = Plane(kRegressionWidth, kRegressionHeight);
  halves.level = unit;
  layer.geometry = MakePlanes(4, kRegressionWidth, kRegressionHeight);
  layer.filtered = {MakePlanes(3, kRegressionWidth, kRegressionHeight),
                    MakePlanes(3, kRegressionWidth, kRegressionHeight)};
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0, kRegressionNoise);
  for (int y = 0; y < kRegressionHeight; ++y) {
    for (int x = 0; x < kRegressionWidth; ++x) {
      const int surface = x < kEdge ? 0 : 1;
      layer.geometry[0].At(x, y) = surface == 0 ? 4.0f : 0.0f;  // the normal, in sigmas
      layer.geometry[2].At(x, y) = surface == 0 ? 0.0f : 4.0f;
      for (size_t c = 0; c < 3; ++c) {
        const float truth = TrueLight(surface, y);
        halves.a[c].At(x, y) = unit * (truth + noise(random));
        halves.b[c].At(x, y) = unit * (truth + noise(random));
        layer.filtered.a[c].At(x, y) = layer.filtered.b[c].At(x, y) = unit * truth;
      }
    }
    halves.is_mixed.At(kEdge, y) = 1;
    LayerFragments& f = layer.fragments;
    f.own_features = 4;
    f.pixels.push_back({kEdge, y, f.places.size(), f.places.size() + 2});
    for (const int surface : {0, 1}) {
      f.places.push_back({kEdge, y});
      f.offsets.insert(f.offsets.end(), {0.0f, 0.0f});
      for (const float feature : {surface == 0 ? 4.0f : 0.0f, 0.0f, surface == 0 ? 0.0f : 4.0f, 0.0f})
        f.features.push_back(feature);
      for (size_t h = 0; h < 2; ++h) {
        const bool is_missing = h == 0 && y == kUnsampledRow && surface == 1;
        f.share[h].push_back(is_missing ? 0.0f : kCovered);
        f.coverage[h].push_back(kCovered);
        for (size_t c = 0; c < 3; ++c) {
          const float truth = TrueLight(surface, y);
          f.light[h].push_back(is_missing ? 0.0f : unit * (truth + noise(random) / std::sqrt(kCovered)));
          layer.filtered.points[h].push_back(unit * 1.25f * truth);
        }
      }
    }
  }
  return layer;
}

Candidate Fit(const Layer& layer, TaskPool* pool = nullptr) {
  return FitLight(layer.halves, layer.fragments, layer.geometry, layer.filtered, {}, kLightKnee, pool);
}

/// Where the light of a surface in row y is in Candidate::points; its first channel.
size_t PointOf(int surface, int y) { return 3 * (2 * static_cast<size_t>(y) + static_cast<size_t>(surface)); }

TEST(LightRegression, FindsTheLightOfEachSurfaceOfAnEdge) {
  const Layer layer = TwoSurfaces(1);
  const Candidate fit = Fit(layer);
  for (const int surface : {0, 1}) {
    double of_noise = 0;
    double of_fit = 0;
    double bias = 0;
    for (int y = 0; y < kRegressionHeight; ++y) {
      const size_t at = PointOf(surface, y);
      const auto truth = static_cast<double>(TrueLight(surface, y));
      const double off = static_cast<double>(fit.points[0][at]) - truth;
      bias += off / kRegressionHeight;
      of_fit += off * off;
      of_noise += y == kUnsampledRow && surface == 1
                      ? 0
                      : std::pow(static_cast<double>(layer.fragments.light[0][at]) - truth, 2);
    }
    EXPECT_NEAR(bias, 0, 0.1) << surface;  // F errs by 0.25 to 1
    EXPECT_LT(of_fit, of_noise / 5) << surface;
  }
}

TEST(LightRegression, TellsAHalfWithoutSamplesOfASurfaceWhatTheSurfaceShowsNearby) {
  const Layer layer = TwoSurfaces(1);
  const size_t at = PointOf(1, kUnsampledRow);
  ASSERT_EQ(layer.fragments.light[0][at], 0);
  EXPECT_NEAR(Fit(layer).points[0][at], TrueLight(1, kUnsampledRow), 0.3);
}

TEST(LightRegression, TellsTheLightWhereAFragmentLies) {
  Layer layer = TwoSurfaces(1);
  constexpr float kSlope = 0.5f;  // of the light of both surfaces, a pixel down
  const auto lit = [](float y) { return 20 + kSlope * y; };
  for (int y = 0; y < kRegressionHeight; ++y) {
    for (Planes* light : {&layer.halves.a, &layer.halves.b, &layer.filtered.a, &layer.filtered.b}) {
      for (Plane& plane : *light) std::fill_n(plane.Row(y), kRegressionWidth, lit(static_cast<float>(y)));
    }
    for (const int surface : {0, 1}) {
      const size_t at = PointOf(surface, y);
      const float down = surface == 0 ? -0.25f : 0.25f;
      layer.fragments.offsets[2 * (at / 3) + 1] = down;
      for (size_t h = 0; h < 2; ++h) {
        for (size_t k = at; k < at + 3; ++k)
          layer.fragments.light[h][k] = layer.filtered.points[h][k] = lit(static_cast<float>(y) + down);
      }
    }
  }
  const Candidate fit = Fit(layer);
  const size_t row = kRegressionHeight / 2;
  EXPECT_NEAR(fit.points[0][PointOf(0, row)], lit(row - 0.25f), 1e-3f);
  EXPECT_NEAR(fit.points[0][PointOf(1, row)], lit(row + 0.25f), 1e-3f);
}

TEST(LightRegression, LeavesWhatIsNotMixedAlone) {
  const Layer layer = TwoSurfaces(1);
  const Candidate fit = Fit(layer);
  for (int y = 0; y < kRegressionHeight; ++y) {
    for (int x = 0; x < kRegressionWidth; ++x) EXPECT_EQ(fit.a[1].At(x, y), layer.filtered.a[1].At(x, y));
  }
}

TEST(LightRegression, FitsMixedPixelsOfOneSurface) {
  Layer layer = TwoSurfaces(1);
  layer.halves.is_mixed.At(5, 9) = 1;
  layer.filtered.a[0].At(5, 9) = layer.filtered.b[0].At(5, 9) = 1.25f * TrueLight(0, 9);
  EXPECT_NEAR(Fit(layer).a[0].At(5, 9), TrueLight(0, 9), 0.12f);
}

TEST(LightRegression, FollowsTheUnitOfLight) {
  const Candidate one = Fit(TwoSurfaces(1));
  const Candidate three = Fit(TwoSurfaces(3));
  for (size_t i = 0; i < one.points[0].size(); ++i)
    EXPECT_NEAR(three.points[0][i], 3 * one.points[0][i], 1e-4f * three.points[0][i]);
}

TEST(LightRegression, LeavesUnusableLightOut) {
  Layer layer = TwoSurfaces(1);
  layer.fragments.light[0][3 * 20] = 1e20f;
  layer.halves.a[0].At(kEdge - 1, 10) = 1e20f;
  const Candidate fit = Fit(layer);
  for (const float value : fit.points[0]) EXPECT_LT(std::abs(value), 10) << value;
}

TEST(LightRegression, GivesTheSameBitsForAnyPool) {
  const Layer layer = TwoSurfaces(1);
  ShufflingPool pool(4);
  const Candidate alone = Fit(layer);
  const Candidate shuffled = Fit(layer, &pool);
  EXPECT_EQ(alone.points, shuffled.points);
}

TEST(LightRegression, EqualsItsOracleInAnyMemoryOfADevice) {
  Layer layer = TwoSurfaces(1);
  layer.fragments.light[0][3 * 20] = 1e20f;
  layer.halves.is_mixed.At(5, 9) = 1;  // with no model beside it
  layer.geometry[1].At(6, 9) = std::numeric_limits<float>::quiet_NaN();
  for (int y = 3; y < 9; ++y) layer.halves.is_mixed.At(kEdge + 3, y) = 1;
  const Candidate here = Fit(layer);
  for (const bool is_small : {false, true}) {
    const Candidate oracle = Fit(layer, PoolWithOracle(is_small).get());
    EXPECT_EQ(here.points, oracle.points);
    EXPECT_TRUE(AreEqual(here.a, oracle.a));
    EXPECT_TRUE(AreEqual(here.b, oracle.b));
  }
}

}  // namespace
}  // namespace lumifold::filter
