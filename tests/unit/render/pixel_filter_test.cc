#include "worker/render/sampling/pixel_filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace lumifold::render {
namespace {

using Kind = PixelFilter::Kind;

constexpr int kSteps = 1 << 16;

/// Mean of (distance from the centre)^power over all random numbers.
double Moment(const PixelFilter& filter, int power) {
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const float u = (static_cast<float>(i) + 0.5f) / kSteps;
    sum += std::pow(static_cast<double>(filter.Warp(u)) - 0.5, power);
  }
  return sum / kSteps;
}

/// The same by integrating the function itself.
template <typename Function>
double Expected(Function function, double width, int power) {
  double weights = 0;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = (i + 0.5) / kSteps - 0.5;
    weights += function(x);
    sum += function(x) * std::pow(x * width, power);
  }
  return sum / weights;
}

TEST(PixelFilter, ABoxOfOnePixelKeepsEveryNumber) {
  const PixelFilter pixel;
  const PixelFilter box(Kind::kBox, 1);
  for (const float u : {0.0f, 0.1f, 0.3333333f, 0.99999994f}) {
    EXPECT_EQ(pixel.Warp(u), u);
    EXPECT_EQ(box.Warp(u), u);
  }
}

TEST(PixelFilter, PointsHaveTheDensityOfTheFunction) {
  const auto gaussian = [](double x) { return std::exp(-8 * x * x); };
  const auto blackman_harris = [](double x) {
    const double v = 2 * std::numbers::pi * (x + 0.5);
    return 0.35875 - 0.48829 * std::cos(v) + 0.14128 * std::cos(2 * v) - 0.01168 * std::cos(3 * v);
  };
  for (const float width : {1.5f, 2.0f, 3.3f}) {
    const auto w = static_cast<double>(width);
    for (const int power : {2, 4, 6}) {
      EXPECT_NEAR(Moment(PixelFilter(Kind::kBox, width), power) / (std::pow(w / 2, power) / (power + 1)), 1,
                  1e-4);
      EXPECT_NEAR(Moment(PixelFilter(Kind::kGaussian, width), power) / Expected(gaussian, w, power), 1, 1e-3);
      EXPECT_NEAR(
          Moment(PixelFilter(Kind::kBlackmanHarris, width), power) / Expected(blackman_harris, w, power), 1,
          power < 6 ? 1e-2 : 4e-2)
          << power;
    }
  }
}

TEST(PixelFilter, IsEvenAndStaysInItsWidth) {
  for (const Kind kind : {Kind::kBox, Kind::kGaussian, Kind::kBlackmanHarris}) {
    const PixelFilter filter(kind, 3);
    EXPECT_EQ(filter.Warp(0.5f), 0.5f);
    EXPECT_EQ(filter.Warp(0), -1);
    EXPECT_LE(filter.Warp(std::nextafter(1.0f, 0.0f)), 2);
    float last = -2;
    for (int i = 0; i <= 1000; ++i) {
      const float u = static_cast<float>(i) / 1024;
      EXPECT_GT(filter.Warp(u), last);
      last = filter.Warp(u);
      EXPECT_NEAR(filter.Warp(1 - u) - 0.5f, 0.5f - filter.Warp(u), 1e-5);
    }
  }
}

}  // namespace
}  // namespace lumifold::render
