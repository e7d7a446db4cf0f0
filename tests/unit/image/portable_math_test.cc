#include "filter/image/portable_math.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace lumifold {
namespace {

/// |got - truth| in units in the last place of the truth as float.
double UlpError(float got, double truth) {
  const float nearest = static_cast<float>(std::abs(truth));
  const double ulp = static_cast<double>(std::nextafter(nearest, INFINITY)) - static_cast<double>(nearest);
  return std::abs(static_cast<double>(got) - truth) / ulp;
}

TEST(PortableMath, ExpStaysWithinTwoUlp) {
  double worst = 0;
  for (int i = -869999; i <= 886999; ++i) {
    const float x = static_cast<float>(i) * 1e-4f;
    worst = std::max(worst, UlpError(Exp(x), std::exp(static_cast<double>(x))));
  }
  EXPECT_LT(worst, 2.0);
}

TEST(PortableMath, ExpSaturatesOutsideItsRange) {
  EXPECT_EQ(Exp(-87.01f), 0.0f);
  EXPECT_EQ(Exp(-1e30f), 0.0f);
  EXPECT_EQ(Exp(88.75f), std::numeric_limits<float>::infinity());
  EXPECT_EQ(Exp(1e30f), std::numeric_limits<float>::infinity());
  EXPECT_EQ(Exp(0.0f), 1.0f);
}

TEST(PortableMath, LogStaysWithinTwoUlp) {
  double worst = 0;
  for (float x = 1e-45f; x < 1e38f; x = std::max(x * 1.0001f, std::nextafter(x, INFINITY))) {
    if (x == 1.0f) continue;  // the truth is 0, which has no unit in the last place
    worst = std::max(worst, UlpError(Log(x), std::log(static_cast<double>(x))));
  }
  for (int i = -500; i <= 500; ++i) {
    if (i == 0) continue;
    const float x = 1.0f + static_cast<float>(i) * 1e-6f;
    worst = std::max(worst, UlpError(Log(x), std::log(static_cast<double>(x))));
  }
  EXPECT_LT(worst, 2.0);
}

TEST(PortableMath, LogOfTheEdges) {
  EXPECT_EQ(Log(0.0f), -std::numeric_limits<float>::infinity());
  EXPECT_EQ(Log(1.0f), 0.0f);
  EXPECT_TRUE(std::isnan(Log(-1.0f)));
}

TEST(PortableMath, PowKeepsItsRelativeError) {
  double worst = 0;
  for (float x = 1e-6f; x < 1e6f; x *= 1.013f) {
    for (float y = -5.0f; y <= 5.0f; y += 0.137f) {
      const double truth = std::pow(static_cast<double>(x), static_cast<double>(y));
      worst = std::max(worst, std::abs(static_cast<double>(Pow(x, y)) - truth) / truth);
    }
  }
  EXPECT_LT(worst, 1e-5);
  EXPECT_EQ(Pow(0.0f, 2.4f), 0.0f);
  EXPECT_EQ(Pow(0.0f, 0.0f), 1.0f);
}

TEST(PortableMath, SinCosKeepTheirAbsoluteError) {
  double worst = 0;
  for (int i = -1000000; i <= 1000000; ++i) {
    const float x = static_cast<float>(i) * 1e-3f;
    float s = 0;
    float c = 0;
    SinCos(x, &s, &c);
    worst = std::max(worst, std::abs(static_cast<double>(s) - std::sin(static_cast<double>(x))));
    worst = std::max(worst, std::abs(static_cast<double>(c) - std::cos(static_cast<double>(x))));
  }
  EXPECT_LT(worst, 5e-7);
}

TEST(PortableMath, Atan2KeepsItsAbsoluteErrorInAllQuadrants) {
  double worst = 0;
  for (int i = 0; i < 100000; ++i) {
    const double angle = -3.14159 + 6.28318 * i / 100000;
    for (const double radius : {1e-10, 1.0, 3e10}) {
      const float y = static_cast<float>(radius * std::sin(angle));
      const float x = static_cast<float>(radius * std::cos(angle));
      const double truth = std::atan2(static_cast<double>(y), static_cast<double>(x));
      worst = std::max(worst, std::abs(static_cast<double>(Atan2(y, x)) - truth));
    }
  }
  EXPECT_LT(worst, 1e-6);
  EXPECT_EQ(Atan2(0.0f, 0.0f), 0.0f);
  EXPECT_FLOAT_EQ(Atan2(-0.0f, -1.0f), kPi);
}

TEST(PortableMath, AcosKeepsItsAbsoluteErrorAndClamps) {
  double worst = 0;
  for (int i = -100000; i <= 100000; ++i) {
    const float x = static_cast<float>(i) * 1e-5f;
    worst = std::max(worst, std::abs(static_cast<double>(Acos(x)) - std::acos(static_cast<double>(x))));
  }
  EXPECT_LT(worst, 1e-6);
  EXPECT_EQ(Acos(2.0f), 0.0f);
  EXPECT_FLOAT_EQ(Acos(-2.0f), kPi);
}

}  // namespace
}  // namespace lumifold
