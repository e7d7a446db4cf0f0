#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/layered_image.h"
#include "filter/image/planes.h"
#include "filter/metrics/metrics.h"
#include "tests/charts/metrics/blotch.h"
#include "tests/charts/metrics/flicker.h"
#include "tests/charts/metrics/reference_noise.h"
#include "tests/charts/metrics/seam.h"
#include "tests/charts/metrics/seeds.h"
#include "tests/unit/metrics/color_of.h"

namespace lumifold::metrics {
namespace {

/// A grey picture of displayed values `base` + add(x, y).
template <typename Function>
LayeredImage Grey(int width, int height, float base, Function add) {
  LayeredImage image(width, height);
  const ColorView color = image.AddColor("");
  ForEachPixel(width, height, [&](int x, int y) {
    const float value = LinearFromSrgb(base + add(x, y));
    for (const FloatView& channel : color) channel.At(x, y) = value;
  });
  return image;
}

LayeredImage GreyNoise(int width, int height, float sigma, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0, sigma);
  return Grey(width, height, 0.5f, [&](int, int) { return normal(random); });
}

LayeredImage Flat(int width, int height, float displayed) {
  return Grey(width, height, displayed, [](int, int) { return 0.0f; });
}

TEST(ReferenceNoise, IsTheErrorOfTheMeanOfTwoHalves) {
  constexpr float kSigma = 0.02f;  // of a half
  const LayeredImage a = GreyNoise(128, 128, kSigma, 1);
  const LayeredImage b = GreyNoise(128, 128, kSigma, 2);
  EXPECT_NEAR(Mse255Noise(ColorOf(a), ColorOf(b)), std::pow(255 * kSigma, 2) / 2, 0.5);
}

TEST(ReferenceNoise, OfRelMseMatchesAHandComputedValue) {
  LayeredImage a(1, 1);
  LayeredImage b(1, 1);
  for (const FloatView& channel : a.AddColor("")) channel.At(0, 0) = 0.3f;
  for (const FloatView& channel : b.AddColor("")) channel.At(0, 0) = 0.1f;
  EXPECT_NEAR(RelMseNoise(ColorOf(a), ColorOf(b)), 0.01 / 0.05, 1e-6);
}

TEST(Seeds, TellVarianceFromBias) {
  constexpr float kSigma = 0.03f;
  constexpr float kBias = 0.05f;
  std::vector<LayeredImage> images;
  for (uint32_t seed = 0; seed < 8; ++seed) images.push_back(GreyNoise(64, 64, kSigma, seed));
  std::vector<ConstColorView> pictures;
  for (const LayeredImage& image : images) pictures.push_back(ColorOf(image));
  const LayeredImage reference = Flat(64, 64, 0.5f + kBias);
  const SeedError error = *MeasureSeeds(pictures, ColorOf(reference));
  EXPECT_NEAR(error.variance, std::pow(255 * kSigma, 2), 2);
  EXPECT_NEAR(error.bias_squared, std::pow(255 * kBias, 2), 4);
  double mse = 0;
  for (const ConstColorView& picture : pictures) mse += Mse255(picture, ColorOf(reference)) / 8;
  EXPECT_NEAR(error.variance + error.bias_squared, mse, 1e-6 * mse);
}

TEST(Seeds, NeedTwoPictures) {
  const LayeredImage image = Flat(4, 4, 0.5f);
  EXPECT_FALSE(MeasureSeeds({ColorOf(image)}, ColorOf(image)).ok());
}

TEST(Flicker, IsMeanAndTailOfTheChange) {
  const LayeredImage still = Flat(20, 10, 0.4f);
  const LayeredImage moved = Grey(20, 10, 0.4f, [](int x, int y) { return x == 0 && y < 4 ? 0.2f : 0.0f; });
  const Flicker flicker = MeasureFlicker(ColorOf(still), ColorOf(moved));
  EXPECT_NEAR(flicker.mean, 255 * 0.2 * 4 / 200, 1e-3);
  EXPECT_NEAR(flicker.percentile99, 51, 0.01);  // four of two hundred values are more than 1 %
  EXPECT_EQ(MeasureFlicker(ColorOf(still), ColorOf(still)).percentile99, 0.0);
}

TEST(Blotch, IsOneForTheNoisyPictureItself) {
  const LayeredImage noisy = GreyNoise(64, 64, 0.05f, 3);
  const LayeredImage reference = Flat(64, 64, 0.5f);
  const Blotch blotch = *MeasureBlotch(ColorOf(noisy), ColorOf(noisy), ColorOf(reference));
  EXPECT_NEAR(blotch.luminance, 1.0, 1e-9);
  EXPECT_EQ(blotch.chroma, 0.0);  // grey noise has no chroma
}

TEST(Blotch, FindsSpotsThatAFilterMade) {
  const LayeredImage noisy = GreyNoise(64, 64, 0.05f, 4);
  const LayeredImage reference = Flat(64, 64, 0.5f);
  const LayeredImage spots =
      Grey(64, 64, 0.5f, [](int x, int y) { return (x / 16 + y / 16) % 2 == 0 ? 0.01f : -0.01f; });
  EXPECT_GT(MeasureBlotch(ColorOf(spots), ColorOf(noisy), ColorOf(reference))->luminance, 1.5);
  EXPECT_EQ(MeasureBlotch(ColorOf(reference), ColorOf(noisy), ColorOf(reference))->luminance, 0.0);
  EXPECT_TRUE(std::isinf(MeasureBlotch(ColorOf(spots), ColorOf(reference), ColorOf(reference))->luminance));
}

TEST(Blotch, NeedsTwoBlocks) {
  const LayeredImage image = Flat(15, 8, 0.5f);
  EXPECT_FALSE(MeasureBlotch(ColorOf(image), ColorOf(image), ColorOf(image)).ok());
}

TEST(SeamIndex, StandsOutWhereTilesMeet) {
  const LayeredImage untiled = Flat(64, 64, 0.5f);
  const auto even = [](int x, int y) { return (x + y) % 2 == 0 ? 0.01f : -0.01f; };
  const LayeredImage everywhere = Grey(64, 64, 0.5f, even);
  EXPECT_NEAR(SeamIndex(ColorOf(everywhere), ColorOf(untiled), 16), 1.0, 0.05);
  const LayeredImage seams =
      Grey(64, 64, 0.5f, [](int x, int) { return x == 16 || x == 31 ? 0.05f : 0.001f; });
  EXPECT_GT(SeamIndex(ColorOf(seams), ColorOf(untiled), 16), 5.0);
  EXPECT_EQ(SeamIndex(ColorOf(untiled), ColorOf(untiled), 16), 0.0);
}

TEST(SeamIndex, DoesNotTakeTheFramesEdgeForASeam) {
  const LayeredImage untiled = Flat(64, 64, 0.5f);
  const LayeredImage frame =
      Grey(64, 64, 0.5f, [](int x, int y) { return x == 0 || y == 63 ? 0.05f : 0.0f; });
  EXPECT_LT(SeamIndex(ColorOf(frame), ColorOf(untiled), 16), 1.5);
}

}  // namespace
}  // namespace lumifold::metrics
