#include "worker/render/sampling/sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <utility>

namespace lumifold::render {
namespace {

constexpr uint64_t kSequenceSeed = 7;

/// Whether each cell of a columns x rows grid contains exactly one of `count` points of one half.
bool FillsGrid(uint32_t half, int64_t pixel, uint32_t pair, int columns, int rows) {
  std::set<std::pair<int, int>> cells;
  const uint32_t count = static_cast<uint32_t>(columns * rows);
  for (uint32_t i = 0; i < count; ++i) {
    const scene::Vec2 p = Sampler(kSequenceSeed, 0, pixel, 2 * i + half).Get2D(pair);
    cells.insert({static_cast<int>(p.x * static_cast<float>(columns)),
                  static_cast<int>(p.y * static_cast<float>(rows))});
  }
  return cells.size() == count;
}

TEST(Sampler, EachHalfIsStratifiedInEveryElementaryInterval) {
  for (uint32_t half = 0; half < 2; ++half) {
    for (uint32_t pair = 0; pair < 12; ++pair) {
      for (int columns = 1; columns <= 64; columns *= 2) {
        EXPECT_TRUE(FillsGrid(half, 1000 + pair, pair, columns, 64 / columns))
            << "half " << half << " pair " << pair;
      }
    }
  }
}

TEST(Sampler, HalvesAreIndependent) {
  // The mean product of the halves' estimates of one integral must equal the product of their means: the
  // covariance is 0.
  double covariance = 0;
  double variance = 0;
  constexpr int kPixels = 4000;
  constexpr uint32_t kSamples = 8;
  for (int64_t pixel = 0; pixel < kPixels; ++pixel) {
    double sum[2] = {0, 0};
    for (uint32_t i = 0; i < 2 * kSamples; ++i) {
      const scene::Vec2 p = Sampler(kSequenceSeed, 0, pixel, i).Get2D(3);
      sum[i & 1] += static_cast<double>(p.x * p.y) - 0.25;
    }
    covariance += sum[0] * sum[1];
    variance += 0.5 * (sum[0] * sum[0] + sum[1] * sum[1]);
  }
  EXPECT_LT(std::abs(covariance / variance), 4 / std::sqrt(static_cast<double>(kPixels)));
}

TEST(Sampler, ConvergesFasterThanRandomNumbers) {
  double error2 = 0;
  constexpr int kPixels = 500;
  constexpr uint32_t kSamples = 256;
  for (int64_t pixel = 0; pixel < kPixels; ++pixel) {
    double sum = 0;
    for (uint32_t i = 0; i < kSamples; ++i) {
      const scene::Vec2 p = Sampler(kSequenceSeed, 0, pixel, 2 * i).Get2D(5);
      sum += static_cast<double>(p.x * p.y);
    }
    const double error = sum / kSamples - 0.25;
    error2 += error * error;
  }
  const double random_variance = (1.0 / 9 - 1.0 / 16) / kSamples;
  EXPECT_LT(error2 / kPixels, 0.02 * random_variance);
}

TEST(SamplerPacket, EqualsSeparateSamplers) {
  for (const uint32_t first : {0u, 5u, 1u << 20}) {
    const SamplerPacket packet(kSequenceSeed, 3, 77, first);
    for (uint32_t i = 0; i < SamplerPacket::kSamples; ++i) {
      const Sampler& together = packet.samplers()[i];
      const Sampler alone(kSequenceSeed, 3, 77, first + i);
      for (uint32_t pair = 0; pair < 4; ++pair) {
        EXPECT_EQ(together.Get2D(pair).x, alone.Get2D(pair).x) << first << " + " << i << " pair " << pair;
        EXPECT_EQ(together.Get2D(pair).y, alone.Get2D(pair).y) << first << " + " << i << " pair " << pair;
        EXPECT_EQ(together.Key(pair), alone.Key(pair));
      }
    }
  }
}

TEST(Sampler, DependsOnEveryPartOfItsKey) {
  const scene::Vec2 base = Sampler(1, 2, 3, 4).Get2D(5);
  EXPECT_EQ(base.x, Sampler(1, 2, 3, 4).Get2D(5).x);
  EXPECT_NE(base.x, Sampler(2, 2, 3, 4).Get2D(5).x);
  EXPECT_NE(base.x, Sampler(1, 3, 3, 4).Get2D(5).x);
  EXPECT_NE(base.x, Sampler(1, 2, 4, 4).Get2D(5).x);
  EXPECT_NE(base.x, Sampler(1, 2, 3, 5).Get2D(5).x);
  EXPECT_NE(base.x, Sampler(1, 2, 3, 4).Get2D(6).x);
}

}  // namespace
}  // namespace lumifold::render
