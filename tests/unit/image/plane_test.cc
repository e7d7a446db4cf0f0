#include "filter/image/plane.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

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

TEST(Plane, PacksTheRowsOfLists) {
  Plane plane = Plane::Packed(1, 1000);
  EXPECT_EQ(plane.view().stride(), 1);
  plane.Fill(4.0f);
  plane.At(0, 999) = 9.0f;
  const Plane copy = plane.Clone();
  EXPECT_EQ(copy.view().stride(), 1);
  EXPECT_EQ(copy.At(0, 998), 4.0f);
  EXPECT_EQ(copy.At(0, 999), 9.0f);
  EXPECT_EQ(Plane::Packed(16, 0).height(), 0);
}

TEST(Plane, TruncateDropsRows) {
  Plane plane(3, 4);
  plane.At(2, 1) = 7.0f;
  plane.Truncate(2);
  EXPECT_EQ(plane.height(), 2);
  EXPECT_EQ(plane.At(2, 1), 7.0f);
  EXPECT_EQ(plane.Clone().height(), 2);
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

TEST(LayeredImage, PartsOfAListAreLists) {
  LayeredImage list = LayeredImage::List(1, 40);
  const FloatView values = list.Add("sample");
  EXPECT_EQ(values.stride(), 1);
  for (int row = 0; row < 40; ++row) {
    EXPECT_EQ(values.At(0, row), 0.0f);
    values.At(0, row) = static_cast<float>(row);
  }
  std::vector<LayeredImage> pieces;
  pieces.push_back(list.Crop({0, 10, 1, 40}));
  pieces.push_back(list.Crop({0, 0, 1, 10}));
  LayeredImage joined = JoinRows(pieces);
  EXPECT_EQ(joined.Get("sample").stride(), 1);
  for (int row = 0; row < 40; ++row)
    EXPECT_EQ(joined.Get("sample").At(0, row), static_cast<float>((row + 10) % 40));
  joined.Truncate(30);
  EXPECT_EQ(joined.height(), 30);
  EXPECT_EQ(joined.Get("sample").height(), 30);
}

}  // namespace
}  // namespace lumifold
