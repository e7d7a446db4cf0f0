#include "filter/metrics/ssim.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "filter/image/color.h"
#include "filter/image/layered_image.h"
#include "filter/image/planes.h"
#include "tests/unit/metrics/color_of.h"

namespace lumifold::metrics {
namespace {

/// A grey picture of one displayed value.
LayeredImage Flat(int side, float displayed) {
  LayeredImage image(side, side);
  for (const FloatView& channel : image.AddColor("")) {
    ForEachPixel(side, side, [&](int x, int y) { channel.At(x, y) = LinearFromSrgb(displayed); });
  }
  return image;
}

/// Grey noise around a displayed value of 0.5; the same for the same seed.
LayeredImage Noise(int side, float amplitude, uint32_t seed) {
  LayeredImage image(side, side);
  const ColorView color = image.AddColor("");
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  ForEachPixel(side, side, [&](int x, int y) {
    const float value = LinearFromSrgb(0.5f + amplitude * uniform(random));
    for (const FloatView& channel : color) channel.At(x, y) = value;
  });
  return image;
}

TEST(Ssim, IsOneForEqualPictures) {
  const LayeredImage image = Noise(32, 0.4f, 1);
  EXPECT_NEAR(*Ssim(ColorOf(image), ColorOf(image)), 1.0, 1e-12);
}

TEST(Ssim, OfFlatPicturesIsTheirLuminanceTerm) {
  // Without structure SSIM is (2 a b + C1) / (a^2 + b^2 + C1): a = 0.4, b = 0.6.
  EXPECT_NEAR(*Ssim(ColorOf(Flat(16, 0.4f)), ColorOf(Flat(16, 0.6f))), 0.4801 / 0.5201, 1e-6);
}

TEST(Ssim, OfAnInvertedPictureIsItsContrastTermNegated) {
  // Windows of noise about 0.5 and their mirror image have equal variances v and covariance -v: the mean of
  // (C2 - 2 v) / (C2 + 2 v) over windows with v far over C2 = 0.0009 lies just above -1.
  LayeredImage image = Noise(24, 0.45f, 2);
  LayeredImage inverted = Noise(24, -0.45f, 2);
  const double index = *Ssim(ColorOf(inverted), ColorOf(image));
  EXPECT_LT(index, -0.9);
  EXPECT_GT(index, -1.0);
}

TEST(Ssim, AgreesWithOneWindowSummedByHand) {
  const LayeredImage a = Noise(11, 0.3f, 3);
  const LayeredImage b = Noise(11, 0.3f, 4);
  double total = 0, ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
  ForEachPixel(11, 11, [&](int x, int y) {
    const double w = std::exp(-((x - 5) * (x - 5) + (y - 5) * (y - 5)) / (2 * 1.5 * 1.5));
    const double p = static_cast<double>(SrgbFromLinear(ColorOf(a)[0].At(x, y)));
    const double q = static_cast<double>(SrgbFromLinear(ColorOf(b)[0].At(x, y)));
    total += w, ma += w * p, mb += w * q, aa += w * p * p, bb += w * q * q, ab += w * p * q;
  });
  ma /= total, mb /= total;
  const double variances = aa / total - ma * ma + bb / total - mb * mb;
  const double covariance = ab / total - ma * mb;
  const double expected =
      (2 * ma * mb + 1e-4) * (2 * covariance + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (variances + 9e-4));
  EXPECT_NEAR(*Ssim(ColorOf(a), ColorOf(b)), expected, 1e-5);
}

TEST(Ssim, RefusesAPictureSmallerThanItsWindow) {
  const LayeredImage image = Flat(10, 0.5f);
  EXPECT_EQ(Ssim(ColorOf(image), ColorOf(image)).status().message(), "SSIM needs 11x11 pixels, not 10x10");
}

TEST(MsSsim, IsOneForEqualPictures) {
  const LayeredImage image = Noise(176, 0.4f, 5);
  EXPECT_NEAR(*MsSsim(ColorOf(image), ColorOf(image)), 1.0, 1e-12);
}

TEST(MsSsim, OfFlatPicturesIsTheLastScalesLuminanceTerm) {
  EXPECT_NEAR(*MsSsim(ColorOf(Flat(176, 0.4f)), ColorOf(Flat(176, 0.6f))), std::pow(0.4801 / 0.5201, 0.1333),
              1e-6);
}

TEST(MsSsim, MindsFineNoiseLessThanSsimDoes) {
  const LayeredImage truth = Flat(176, 0.5f);
  const LayeredImage noisy = Noise(176, 0.1f, 6);
  EXPECT_GT(*MsSsim(ColorOf(noisy), ColorOf(truth)), *Ssim(ColorOf(noisy), ColorOf(truth)));
}

TEST(MsSsim, RefusesAPictureTooSmallForFiveScales) {
  const LayeredImage image = Flat(175, 0.5f);
  EXPECT_FALSE(MsSsim(ColorOf(image), ColorOf(image)).ok());
}

}  // namespace
}  // namespace lumifold::metrics
