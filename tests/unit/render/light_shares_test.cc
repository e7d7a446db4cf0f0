#include "worker/render/light_shares.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

namespace lumifold::render {
namespace {

double SumOf(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }

TEST(LightShares, FewLightsHaveWholeParts) {
  for (int lights = 1; lights <= kFewLights; ++lights) {
    for (const double ratio : {1.0, 0.7, 0.1, 1e-6}) {
      LightPowers powers;
      for (int i = 0; i < lights; ++i)
        (i % 3 == 2 ? powers.infinite : powers.finite).push_back(5 * std::pow(ratio, i));
      const std::vector<double> shares = LightShares(powers);
      ASSERT_EQ(shares.size(), static_cast<size_t>(lights));
      EXPECT_EQ(SumOf(shares), 1);
      for (const double share : shares) {
        EXPECT_GT(share, 0);
        EXPECT_EQ(share * 32, std::floor(share * 32)) << lights << " lights, " << ratio;
      }
    }
  }
}

TEST(LightShares, AreInProportionToPower) {
  EXPECT_EQ(LightShares({{3, 1}, {}}), (std::vector<double>{0.75, 0.25}));
  EXPECT_EQ(LightShares({{1000, 1}, {}}), (std::vector<double>{0.875, 0.125}));
  EXPECT_EQ(LightShares({{2, 0}, {}}), (std::vector<double>{1, 0}));
  const std::vector<double> many = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
  const std::vector<double> shares = LightShares({many, {}});
  for (size_t i = 0; i < many.size(); ++i) EXPECT_DOUBLE_EQ(shares[i], many[i] / 55);
}

TEST(LightShares, FiniteAndInfiniteLightsHaveAQuarterAtLeast) {
  EXPECT_EQ(LightShares({{1}, {1e9}}), (std::vector<double>{0.25, 0.75}));
  EXPECT_EQ(LightShares({{1e9}, {1}}), (std::vector<double>{0.75, 0.25}));
  EXPECT_EQ(LightShares({{}, {4}}), (std::vector<double>{1}));
}

TEST(LightShares, OfBlackLightsAreZero) {
  EXPECT_TRUE((LightPowers{{0, 0}, {}}).AllZero());
  EXPECT_TRUE(LightPowers{}.AllZero());
  EXPECT_EQ(LightShares({{0, 0}, {}}), (std::vector<double>{0, 0}));
}

}  // namespace
}  // namespace lumifold::render
