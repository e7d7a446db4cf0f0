#include "filter/kernels/box_mean.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <utility>

#include "tests/support/shuffling_pool.h"

namespace lumifold::filter {
namespace {

Plane BoxMean(const Plane& values, const Plane& weight, int radius, TaskPool* pool = nullptr) {
  Planes one;
  one.push_back(values.Clone());
  return std::move(BoxMeans(one, weight.view(), radius, pool)[0]);
}

TEST(BoxMeans, AveragesWhatWeighsInsideThePicture) {
  Plane values(5, 4);
  Plane weight(5, 4);
  weight.Fill(1);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 5; ++x) values.At(x, y) = static_cast<float>(x + 10 * y);
  }
  weight.At(1, 1) = 0;
  const Plane mean = BoxMean(values, weight, 1);
  EXPECT_NEAR(mean.At(0, 0), (0 + 1 + 10) / 3.0f, 1e-5f);
  EXPECT_NEAR(mean.At(3, 2), 23.0f, 1e-5f);
}

TEST(BoxMeans, IsZeroWhereNothingWeighsAndTakesWindowsOverThePicture) {
  Plane values(3, 2);
  values.Fill(7);
  Plane weight(3, 2);
  EXPECT_EQ(BoxMean(values, weight, 1).At(1, 1), 0.0f);
  weight.At(2, 1) = 0.5f;
  EXPECT_NEAR(BoxMean(values, weight, 9).At(0, 0), 7.0f, 1e-6f);
}

TEST(BoxMeans, EqualsADirectSumAcrossBlocksForAnyRadiusAndPool) {
  constexpr int kWidth = 270;  // over one strip
  constexpr int kHeight = 70;  // over one band
  Planes values = MakePlanes(2, kWidth, kHeight);
  Plane weight(kWidth, kHeight);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      for (Plane& plane : values) plane.At(x, y) = uniform(random);
      weight.At(x, y) = uniform(random) < 0.3f ? 0.0f : uniform(random);
    }
  }
  ShufflingPool pool(5);
  for (const int radius : {1, 2, 3, 4, 12}) {
    const Planes means = BoxMeans(values, weight.view(), radius, nullptr);
    const Planes shuffled = BoxMeans(values, weight.view(), radius, &pool);
    for (int y = 0; y < kHeight; y += 3) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        double mass = 0;
        for (int j = std::max(0, y - radius); j <= std::min(kHeight - 1, y + radius); ++j) {
          for (int i = std::max(0, x - radius); i <= std::min(kWidth - 1, x + radius); ++i) {
            sum += static_cast<double>(values[1].At(i, j) * weight.At(i, j));
            mass += static_cast<double>(weight.At(i, j));
          }
        }
        ASSERT_NEAR(static_cast<double>(means[1].At(x, y)), mass > 0 ? sum / mass : 0, 2e-6)
            << radius << ": " << x << "," << y;
        ASSERT_EQ(means[1].At(x, y), shuffled[1].At(x, y));
      }
    }
  }
}

}  // namespace
}  // namespace lumifold::filter
