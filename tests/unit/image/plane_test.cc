#include "filter/image/plane.h"

#include <gtest/gtest.h>

#include <cstdint>

#include "filter/image/layered_image.h"

namespace lumifold {
namespace {

TEST(Plane, RowsDoNotCrowdIntoFewSetsOfTheCache) {
  constexpr std::ptrdiff_t kFloatsOfEightLines = 8 * Plane::kAlignment / sizeof(float);
  for (const int width : {128, 512, 1000, 1024, 4096})
    EXPECT_NE(Plane(width, 2).view().stride() % kFloatsOfEightLines, 0) << width;
}

TEST(Plane, StartsZeroAndAlignsItsRows) {
  Plane plane(13, 5);
  for (int y = 0; y < 5; ++y) {
    EXPECT_EQ(reinterpret_cast<uintptr_t>(plane.Row(y)) % Plane::kAlignment, 0u);
    for (int x = 0; x < 13; ++x) EXPECT_EQ(plane.At(x, y), 0.0f);
  }
}

TEST(Plane, CloneSharesNothing) {
  Plane plane(3, 2);
  plane.Fill(4.0f);
  const Plane copy = plane.Clone();
  plane.At(1, 1) = 9.0f;
  EXPECT_EQ(copy.At(1, 1), 4.0f);
}

TEST(PlaneView, CropPointsIntoTheSamePixels) {
  Plane plane(8, 6);
  plane.At(3, 2) = 7.0f;
  const FloatView crop = plane.view().Crop({2, 1, 5, 4});
  EXPECT_EQ(crop.width(), 3);
  EXPECT_EQ(crop.height(), 3);
  EXPECT_EQ(crop.At(1, 1), 7.0f);
}

TEST(Rect, InflateStopsAtTheBounds) {
  EXPECT_EQ(Inflate({0, 2, 4, 5}, 3, {0, 0, 6, 6}), (Rect{0, 0, 6, 6}));
  EXPECT_TRUE(Intersect({0, 0, 2, 2}, {2, 0, 4, 2}).IsEmpty());
}

TEST(LayeredImage, KeepsChannelsInTheOrderTheyCame) {
  LayeredImage image(2, 2);
  image.Add("Z");
  image.AddColor("direct");
  ASSERT_EQ(image.channels().size(), 4u);
  EXPECT_EQ(image.channels()[0].name, "Z");
  EXPECT_EQ(image.channels()[3].name, "direct.B");
  EXPECT_TRUE(image.HasColor("direct"));
  EXPECT_FALSE(image.HasColor(""));
}

}  // namespace
}  // namespace lumifold
