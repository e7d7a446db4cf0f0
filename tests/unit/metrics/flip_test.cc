#include "filter/metrics/flip.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "filter/image/layered_image.h"
#include "filter/image/planes.h"
#include "tests/unit/metrics/color_of.h"

namespace lumifold::metrics {
namespace {

// Closed forms and properties of FLIP. tests/cross_check/metrics_oracle.py compares it with a second
// implementation, which convolves with the published two-dimensional kernels.

using Rgb = std::array<float, 3>;

LayeredImage Flat(int width, int height, const Rgb& color) {
  LayeredImage image(width, height);
  const ColorView planes = image.AddColor("");
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(width, height, [&](int x, int y) { planes[c].At(x, y) = color[c]; });
  }
  return image;
}

LayeredImage Noise(int width, int height, float most, uint32_t seed) {
  LayeredImage image = Flat(width, height, {0, 0, 0});
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, most);
  for (const FloatView& plane : image.GetColor("")) {
    ForEachPixel(width, height, [&](int x, int y) { plane.At(x, y) = uniform(random); });
  }
  return image;
}

double FlatFlip(const Rgb& a, const Rgb& b) {
  const LayeredImage first = Flat(5, 3, a);
  const LayeredImage second = Flat(5, 3, b);
  return Flip(ColorOf(first), ColorOf(second));
}

TEST(Flip, IsZeroForEqualPictures) {
  const LayeredImage image = Noise(20, 9, 1.5f, 1);
  EXPECT_EQ(Flip(ColorOf(image), ColorOf(image)), 0.0);
  EXPECT_EQ(HdrFlip(ColorOf(image), ColorOf(image)), 0.0);
}

TEST(Flip, IsOneForTheGreatestDifferenceItKnows) {
  EXPECT_NEAR(FlatFlip({0, 1, 0}, {0, 0, 1}), 1.0, 1e-5);  // green and blue, by definition
}

TEST(Flip, OfFlatGreysFollowsTheirLightness) {
  // Without colour and edges FLIP is |L1 - L2|^0.7, scaled linearly below 0.4 of the difference of green and
  // blue. These have L* a* b* = (87.735, -86.183, 83.179) and (32.297, 79.188, -107.860), and with Hunt's
  // factor of 0.01 L* (87.735, -75.612, 72.977) and (32.297, 25.575, -34.836).
  const double greatest = std::pow(87.735 - 32.297 + std::hypot(-75.612 - 25.575, 72.977 + 34.836), 0.7);
  const double grey = 116 * std::cbrt(0.2) - 16;
  const double darker = 116 * std::cbrt(0.18) - 16;
  EXPECT_NEAR(FlatFlip({0.2f, 0.2f, 0.2f}, {0.18f, 0.18f, 0.18f}),
              0.95 / (0.4 * greatest) * std::pow(grey - darker, 0.7), 2e-4);
  const double black_to_white = std::pow(100.0, 0.7);
  EXPECT_NEAR(FlatFlip({1, 1, 1}, {0, 0, 0}),
              0.95 + 0.05 * (black_to_white - 0.4 * greatest) / (0.6 * greatest), 2e-4);
}

TEST(Flip, StaysInItsRangeAndIsSymmetric) {
  const LayeredImage a = Noise(33, 17, 1.0f, 2);
  const LayeredImage b = Noise(33, 17, 1.0f, 3);
  const Plane map = FlipMap(ColorOf(a), ColorOf(b));
  ForEachPixel(map.width(), map.height(), [&](int x, int y) {
    EXPECT_GE(map.At(x, y), 0.0f);
    EXPECT_LE(map.At(x, y), 1.0f);
  });
  EXPECT_NEAR(Flip(ColorOf(a), ColorOf(b)), Flip(ColorOf(b), ColorOf(a)), 1e-6);
}

TEST(Flip, MindsAnEdgeMoreThanTheSameChangeSpreadOut) {
  const LayeredImage reference = Flat(60, 8, {0.3f, 0.3f, 0.3f});
  LayeredImage edge = Flat(60, 8, {0.3f, 0.3f, 0.3f});
  LayeredImage ramp = Flat(60, 8, {0.3f, 0.3f, 0.3f});
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(60, 8, [&](int x, int y) {
      edge.GetColor("")[c].At(x, y) = x < 30 ? 0.28f : 0.32f;
      ramp.GetColor("")[c].At(x, y) = 0.26f + 0.08f * (static_cast<float>(x) + 0.5f) / 60;
    });
  }
  const Plane at_edge = FlipMap(ColorOf(edge), ColorOf(reference));
  const Plane at_ramp = FlipMap(ColorOf(ramp), ColorOf(reference));
  // Both differ by 0.02 at a quarter of the width, far from edges; next to the edge the first has more FLIP.
  EXPECT_NEAR(at_edge.At(15, 4), at_ramp.At(15, 4), 0.02f);
  EXPECT_GT(at_edge.At(28, 4), at_edge.At(15, 4));
}

TEST(Flip, ClampsToTheDisplayAndTakesNanForBlack) {
  EXPECT_EQ(FlatFlip({3, 3, 3}, {1, 1, 1}), 0.0);
  EXPECT_EQ(FlatFlip({-1, 0, 0}, {0, 0, 0}), 0.0);
  EXPECT_EQ(FlatFlip({std::numeric_limits<float>::quiet_NaN(), 0, 0}, {0, 0, 0}), 0.0);
}

TEST(HdrFlip, SeesDifferencesThatADisplayClips) {
  LayeredImage reference = Noise(24, 16, 0.5f, 4);
  LayeredImage picture = Noise(24, 16, 0.5f, 4);
  for (size_t c = 0; c < 3; ++c) {
    reference.GetColor("")[c].At(12, 8) = 40;
    picture.GetColor("")[c].At(12, 8) = 10;
  }
  EXPECT_EQ(Flip(ColorOf(picture), ColorOf(reference)), 0.0);
  EXPECT_GT(HdrFlipMap(ColorOf(picture), ColorOf(reference)).At(12, 8), 0.2f);
}

TEST(HdrFlip, DoesNotDependOnTheUnitOfLight) {
  const LayeredImage a = Noise(24, 16, 1.0f, 5);
  const LayeredImage b = Noise(24, 16, 1.0f, 6);
  const auto scaled = [](const LayeredImage& image) {
    LayeredImage out = Flat(image.width(), image.height(), {0, 0, 0});
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(image.width(), image.height(), [&](int x, int y) {
        out.GetColor("")[c].At(x, y) = 1024.0f * image.GetColor("")[c].At(x, y);
      });
    }
    return out;
  };
  const LayeredImage a_scaled = scaled(a);
  const LayeredImage b_scaled = scaled(b);
  EXPECT_NEAR(HdrFlip(ColorOf(a), ColorOf(b)), HdrFlip(ColorOf(a_scaled), ColorOf(b_scaled)), 1e-5);
}

TEST(HdrFlip, OfABlackReferenceIsFinite) {
  const LayeredImage black = Flat(6, 6, {0, 0, 0});
  const LayeredImage grey = Flat(6, 6, {0.5f, 0.5f, 0.5f});
  EXPECT_GT(HdrFlip(ColorOf(grey), ColorOf(black)), 0.5);
  EXPECT_EQ(HdrFlip(ColorOf(black), ColorOf(black)), 0.0);
}

}  // namespace
}  // namespace lumifold::metrics
