#include "worker/render/materials/sheen.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

double Density(double sine, double alpha) {
  return (2 + 1 / alpha) * std::pow(sine, 1 / alpha) / (2 * double{kPi});
}

/// 1 + Lambda by its definition: the area of the fibres that a viewer sees without masking, over the area of
/// the surface that he sees.
double OnePlusLambda(double cosine, double alpha) {
  constexpr int kCells = 100;
  const double sine = std::sqrt(1 - cosine * cosine);
  double area = 0;
  for (int i = 0; i < kCells; ++i) {
    const double theta = (i + 0.5) / kCells * double{kPi} / 2;
    for (int k = 0; k < kCells; ++k) {
      const double phi = (k + 0.5) / kCells * 2 * double{kPi};
      const double facing = std::cos(theta) * cosine + std::sin(theta) * std::cos(phi) * sine;
      area += Density(std::sin(theta), alpha) * std::sin(theta) * std::max(facing, 0.0);
    }
  }
  return area * double{kPi} * double{kPi} / (kCells * kCells) / cosine;
}

TEST(Sheen, TheFittedMaskingIsThatOfItsDistribution) {
  for (const float alpha : {0.1f, 0.5f, 0.75f, 1.0f}) {
    const double tolerance = alpha == 0.5f ? 0.07 : 0.03;  // the fit interpolates between its ends
    for (const float cosine : {0.1f, 0.2f, 0.35f, 0.49f, 0.51f, 0.6f, 0.8f, 0.95f}) {
      const float sine = std::sqrt(1 - cosine * cosine);
      const Vec3 direction = {sine, 0, cosine};  // of light and viewer: also of the half vector
      const double lobe = double{SheenLobe(direction, direction, alpha)};
      const double masked =
          Density(double{sine}, double{alpha}) / (4 * double{cosine} * lobe);  // 1 + 2 Lambda
      const double expected = OnePlusLambda(double{cosine}, double{alpha});
      EXPECT_NEAR((1 + masked) / 2 / expected, 1, tolerance) << alpha << " " << cosine;
    }
  }
}

TEST(Sheen, IsReciprocal) {
  const Vec3 low = Normalize(Vec3{0.9f, 0.1f, 0.2f});
  const Vec3 high = Normalize(Vec3{-0.3f, 0.4f, 0.8f});
  for (const float alpha : {kMinSheenAlpha, 0.3f, 1.0f})
    EXPECT_FLOAT_EQ(SheenLobe(low, high, alpha) * high.z, SheenLobe(high, low, alpha) * low.z) << alpha;
}

}  // namespace
}  // namespace lumifold::render
