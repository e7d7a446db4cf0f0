// Independence of the sampler's numbers between pairs, halves, pixels and frames.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "worker/render/sampling/sampler.h"

namespace lumifold::render {
namespace {

using scene::Vec2;

constexpr uint64_t kHalvesSeed = 11;
constexpr int kHalvesPixels = 4000;
constexpr uint32_t kHalfSamples = 8;  // of each half

/// The error of one half's estimate of the integral of x * y by one dimension pair.
double ErrorOf(int64_t pixel, uint32_t half, uint32_t pair, int frame = 0) {
  double sum = 0;
  for (uint32_t i = 0; i < kHalfSamples; ++i) {
    const Vec2 p = Sampler(kHalvesSeed, frame, pixel, 2 * i + half).Get2D(pair);
    sum += static_cast<double>(p.x * p.y) - 0.25;
  }
  return sum;
}

/// Correlation of two errors over many pixels.
template <typename First, typename Second>
double Correlation(const First& first, const Second& second) {
  double product = 0;
  double first2 = 0;
  double second2 = 0;
  for (int64_t pixel = 0; pixel < kHalvesPixels; ++pixel) {
    const double a = first(pixel);
    const double b = second(pixel);
    product += a * b;
    first2 += a * a;
    second2 += b * b;
  }
  return product / std::sqrt(first2 * second2);
}

const double kMaxCorrelation = 4 / std::sqrt(static_cast<double>(kHalvesPixels));  // four standard deviations

TEST(SamplerIndependence, PairsOfDimensionsOfOneHalf) {
  for (uint32_t half = 0; half < 2; ++half) {
    for (uint32_t pair = 1; pair < 12; ++pair) {
      const double correlation = Correlation([&](int64_t pixel) { return ErrorOf(pixel, half, 0); },
                                             [&](int64_t pixel) { return ErrorOf(pixel, half, pair); });
      EXPECT_LT(std::abs(correlation), kMaxCorrelation) << "half " << half << " pair " << pair;
    }
  }
}

TEST(SamplerIndependence, HalvesInEveryPair) {
  for (uint32_t pair = 0; pair < 12; ++pair) {
    const double correlation = Correlation([&](int64_t pixel) { return ErrorOf(pixel, 0, pair); },
                                           [&](int64_t pixel) { return ErrorOf(pixel, 1, pair); });
    EXPECT_LT(std::abs(correlation), kMaxCorrelation) << pair;
  }
}

TEST(SamplerIndependence, NeighbouringPixelsAndFrames) {
  const auto here = [](int64_t pixel) { return ErrorOf(pixel, 0, 2); };
  for (const int64_t distance : {1, 2, 64, 1024}) {
    EXPECT_LT(std::abs(Correlation(here, [&](int64_t pixel) { return ErrorOf(pixel + distance, 0, 2); })),
              kMaxCorrelation)
        << distance;
  }
  EXPECT_LT(std::abs(Correlation(here, [](int64_t pixel) { return ErrorOf(pixel, 0, 2, 1); })),
            kMaxCorrelation);
}

TEST(SamplerIndependence, TwoPairsTogetherAreUniformInFourDimensions) {
  // Two pairs give points of four dimensions: over many pixels each of the 2^4 cells gets an equal number.
  for (uint32_t half = 0; half < 2; ++half) {
    std::array<int, 16> cells = {};
    for (int64_t pixel = 0; pixel < kHalvesPixels; ++pixel) {
      for (uint32_t i = 0; i < kHalfSamples; ++i) {
        const Sampler sampler(kHalvesSeed, 0, pixel, 2 * i + half);
        const Vec2 a = sampler.Get2D(3);
        const Vec2 b = sampler.Get2D(4);
        ++cells[(a.x < 0.5f) + 2 * (a.y < 0.5f) + 4 * (b.x < 0.5f) + 8 * (b.y < 0.5f)];
      }
    }
    const double expected = kHalvesPixels * kHalfSamples / 16.0;
    for (const int count : cells) EXPECT_NEAR(count, expected, 4 * std::sqrt(expected));
  }
}

}  // namespace
}  // namespace lumifold::render
