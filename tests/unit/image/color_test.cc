#include "filter/image/color.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lumifold {
namespace {

TEST(Color, SrgbMatchesTheStandardsFormula) {
  for (int i = 0; i <= 10000; ++i) {
    const float x = static_cast<float>(i) * 1e-4f;
    const double truth =
        x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(static_cast<double>(x), 1 / 2.4) - 0.055;
    EXPECT_NEAR(SrgbFromLinear(x), truth, 2e-6) << x;
  }
}

TEST(Color, SrgbClampsAndTakesNanAsBlack) {
  EXPECT_EQ(SrgbFromLinear(-1.0f), 0.0f);
  EXPECT_EQ(SrgbFromLinear(7.0f), 1.0f);
  EXPECT_EQ(SrgbFromLinear(NAN), 0.0f);
  EXPECT_EQ(LinearFromSrgb(NAN), 0.0f);
}

TEST(Color, LinearFromSrgbInvertsSrgbFromLinear) {
  for (int i = 0; i <= 255; ++i) {
    const float encoded = static_cast<float>(i) / 255.0f;
    EXPECT_NEAR(SrgbFromLinear(LinearFromSrgb(encoded)), encoded, 3e-6);
  }
}

TEST(Color, LuminanceOfWhiteIsOne) { EXPECT_NEAR(Luminance(1, 1, 1), 1.0f, 1e-6f); }

}  // namespace
}  // namespace lumifold
