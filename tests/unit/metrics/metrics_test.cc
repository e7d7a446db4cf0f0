#include "filter/metrics/metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "filter/image/layered_image.h"
#include "tests/unit/metrics/color_of.h"

namespace lumifold::metrics {
namespace {

/// A 2 x 1 picture with one grey value per pixel.
LayeredImage Grey(float left, float right) {
  LayeredImage image(2, 1);
  for (const FloatView& channel : image.AddColor("")) {
    channel.At(0, 0) = left;
    channel.At(1, 0) = right;
  }
  return image;
}

TEST(Mse255, IsZeroForEqualPictures) {
  const LayeredImage image = Grey(0.2f, 3.0f);
  EXPECT_EQ(Mse255(ColorOf(image), ColorOf(image)), 0.0);
  EXPECT_TRUE(std::isinf(Psnr(ColorOf(image), ColorOf(image))));
}

TEST(Mse255, MatchesHandComputedValues) {
  // srgb(0.001) = 0.01292 and srgb(0.002) = 0.02584: a difference of 3.2946 steps in one of two pixels.
  const LayeredImage x = Grey(0.002f, 0.5f);
  const LayeredImage r = Grey(0.001f, 0.5f);
  EXPECT_NEAR(Mse255(ColorOf(x), ColorOf(r)), 3.2946 * 3.2946 / 2, 1e-4);
  // srgb(0.5) = 0.735357, against white: 67.4840 steps.
  const double expected = 67.4840 * 67.4840 / 2;
  EXPECT_NEAR(Mse255(ColorOf(Grey(1.0f, 0.0f)), ColorOf(Grey(0.5f, 0.0f))), expected, 0.05);
  EXPECT_NEAR(Psnr(ColorOf(Grey(1.0f, 0.0f)), ColorOf(Grey(0.5f, 0.0f))), 10 * std::log10(65025 / expected),
              1e-4);
}

TEST(Mse255, ClampsAfterExposure) {
  EXPECT_EQ(Mse255(ColorOf(Grey(5.0f, -1.0f)), ColorOf(Grey(1.0f, 0.0f))), 0.0);
  EXPECT_EQ(Mse255(ColorOf(Grey(2.0f, 4.0f)), ColorOf(Grey(3.0f, 4.0f)), 0.5f),
            Mse255(ColorOf(Grey(1.0f, 2.0f)), ColorOf(Grey(1.5f, 2.0f))));
}

TEST(Mse255, AveragesOverChannels) {
  LayeredImage x = Grey(0.0f, 0.0f);
  const LayeredImage r = Grey(0.0f, 0.0f);
  x.Get("G").At(0, 0) = 1.0f;
  EXPECT_NEAR(Mse255(ColorOf(x), ColorOf(r)), 65025.0 / 6, 1e-6);
}

TEST(RelMse, MatchesHandComputedValues) {
  // (0.3 - 0.2)^2 / (0.04 + 0.01) = 0.2 in one of two pixels.
  EXPECT_NEAR(RelMse(ColorOf(Grey(0.3f, 7.0f)), ColorOf(Grey(0.2f, 7.0f))), 0.1, 1e-6);
}

TEST(TrimmedRelMse, LeavesOutOnePixelInAThousand) {
  LayeredImage reference(100, 20);
  LayeredImage picture(100, 20);
  for (const FloatView& channel : reference.AddColor("")) channel.At(0, 0) = 0;
  for (const FloatView& channel : picture.AddColor("")) {
    for (int i = 0; i < 3; ++i) channel.At(10 * i, 7) = static_cast<float>(i + 1);  // errors 100, 400, 900
  }
  EXPECT_NEAR(RelMse(ColorOf(picture), ColorOf(reference)), 1400.0 / 2000, 1e-6);
  EXPECT_NEAR(TrimmedRelMse(ColorOf(picture), ColorOf(reference)), 100.0 / 1998, 1e-6);
}

TEST(TrimmedRelMse, KeepsAllOfASmallPicture) {
  const LayeredImage x = Grey(0.5f, 0.1f);
  const LayeredImage r = Grey(0.2f, 0.3f);
  EXPECT_NEAR(TrimmedRelMse(ColorOf(x), ColorOf(r)), RelMse(ColorOf(x), ColorOf(r)), 1e-12);
}

}  // namespace
}  // namespace lumifold::metrics
