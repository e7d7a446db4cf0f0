#include "filter/manifold/box_mean.h"

#include <gtest/gtest.h>

namespace lumifold::filter {
namespace {

TEST(BoxMean, AveragesWhatWeighsInsideThePicture) {
  Plane values(5, 4);
  Plane weight(5, 4);
  weight.Fill(1);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 5; ++x) values.At(x, y) = static_cast<float>(x + 10 * y);
  }
  weight.At(1, 1) = 0;
  const Plane mean = BoxMean(values.view(), weight.view(), 1, nullptr);
  EXPECT_NEAR(mean.At(0, 0), (0 + 1 + 10) / 3.0f, 1e-5f);
  EXPECT_NEAR(mean.At(3, 2), 23.0f, 1e-5f);
}

TEST(BoxMean, IsZeroWhereNothingWeighsAndTakesWindowsOverThePicture) {
  Plane values(3, 2);
  values.Fill(7);
  Plane weight(3, 2);
  EXPECT_EQ(BoxMean(values.view(), weight.view(), 1, nullptr).At(1, 1), 0.0f);
  weight.At(2, 1) = 0.5f;
  EXPECT_NEAR(BoxMean(values.view(), weight.view(), 9, nullptr).At(0, 0), 7.0f, 1e-6f);
}

}  // namespace
}  // namespace lumifold::filter
