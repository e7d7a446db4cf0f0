#include "filter/layers/halves.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filter/image/layered_image.h"

namespace lumifold::filter {
namespace {

/// Two halves of one grey layer with nA and nB samples everywhere.
struct TestLayer {
  LayeredImage image;

  TestLayer(int width, int height, float a, float b, float n_a, float n_b) : image(width, height) {
    for (const FloatView& c : image.AddColor("a")) Fill(c, a);
    for (const FloatView& c : image.AddColor("b")) Fill(c, b);
    Fill(image.Add("n_a"), n_a);
    Fill(image.Add("n_b"), n_b);
    Fill(image.Add("validity"), 1);
  }

  static void Fill(FloatView view, float value) {
    for (int y = 0; y < view.height(); ++y) {
      for (int x = 0; x < view.width(); ++x) view.At(x, y) = value;
    }
  }

  Halves Make() const {
    return MakeHalves({image.GetColor("a"), image.GetColor("b"), image.Get("n_a"), image.Get("n_b")},
                      image.Get("validity"), nullptr);
  }
};

TEST(Halves, MeanAndNoiseFollowTheSampleCounts) {
  const Halves halves = TestLayer(4, 3, 2.0f, 6.0f, 3, 1).Make();
  EXPECT_TRUE(halves.has_noise_estimate);
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), nullptr);
  EXPECT_FLOAT_EQ(mean[1].At(2, 1) * halves.scale, 3.0f);
  EXPECT_NEAR(NoiseLevel(halves, halves.a, halves.b, nullptr) * halves.scale, std::sqrt(3.0f), 1e-5f);
}

TEST(Halves, OneEmptyHalfIsUnknownNoiseNotNone) {
  const Halves halves = TestLayer(4, 3, 2.0f, 0.0f, 1, 0).Make();
  EXPECT_FALSE(halves.has_noise_estimate);
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), nullptr);
  EXPECT_FLOAT_EQ(mean[0].At(0, 0) * halves.scale, 2.0f);
  EXPECT_EQ(halves.weight_b.At(0, 0), 0.0f);
  EXPECT_EQ(halves.weight.At(0, 0), 1.0f);
}

TEST(Halves, HoldWhatTheCoveredPartOfAPixelShows) {
  TestLayer layer(4, 3, 1.0f, 3.0f, 2, 2);
  layer.image.Get("validity").At(1, 1) = 0.25f;
  const Halves halves = layer.Make();
  EXPECT_FLOAT_EQ(halves.a[0].At(1, 1) * halves.scale, 4.0f);
  EXPECT_FLOAT_EQ(halves.b[0].At(1, 1) * halves.scale, 12.0f);
  EXPECT_EQ(halves.weight_a.At(1, 1), 0.25f);
  EXPECT_EQ(halves.weight_a.At(0, 0), 1.0f);
}

TEST(Halves, NanAndInfinityInOneHalfLeaveTheOther) {
  TestLayer layer(4, 3, 2.0f, 6.0f, 2, 2);
  layer.image.Get("a.G").At(1, 1) = NAN;
  layer.image.Get("b.R").At(2, 1) = std::numeric_limits<float>::infinity();
  const Halves halves = layer.Make();
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), nullptr);
  EXPECT_FLOAT_EQ(mean[1].At(1, 1) * halves.scale, 6.0f);
  EXPECT_FLOAT_EQ(mean[0].At(2, 1) * halves.scale, 2.0f);
  EXPECT_FLOAT_EQ(mean[2].At(0, 0) * halves.scale, 4.0f);
}

TEST(Halves, ScaleBringsTheMeanNearOneWithoutLoss) {
  for (const float unit : {1e-20f, 1.0f, 1e20f}) {
    const Halves halves = TestLayer(4, 3, 3.0f * unit, 5.0f * unit, 2, 2).Make();
    EXPECT_EQ(halves.a[0].At(0, 0) * halves.scale, 3.0f * unit);
    EXPECT_GE(halves.b[0].At(0, 0), 0.5f);
    EXPECT_LT(halves.a[0].At(0, 0), 2.0f);
  }
}

TEST(NoiseLevel, IsEstimatedFromSecondDifferencesWithoutHalves) {
  TestLayer layer(64, 64, 0, 0, 1, 0);
  uint32_t state = 1;
  for (const FloatView& channel : layer.image.GetColor("a")) {
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x) {
        state = state * 1664525u + 1013904223u;
        channel.At(x, y) = 10.0f + 0.2f * static_cast<float>(x) + static_cast<float>(state >> 8) * 0x1p-24f;
      }
    }
  }
  const Halves halves = layer.Make();
  EXPECT_NEAR(NoiseLevel(halves, halves.a, halves.b, nullptr) * halves.scale, std::sqrt(1 / 12.0f), 0.02f);
}

}  // namespace
}  // namespace lumifold::filter
