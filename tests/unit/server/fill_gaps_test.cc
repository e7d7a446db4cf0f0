#include "server/preview/fill_gaps.h"

#include <gtest/gtest.h>

namespace lumifold::server {
namespace {

/// A picture of 9 x 5 pixels whose left part, of `known` columns, has samples; there R is 2 and G the column.
class FillGapsTest : public ::testing::Test {
 protected:
  void Fill(int known) {
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < known; ++x) {
        samples_.At(x, y) = 4;
        picture_.Get("R").At(x, y) = 2;
        picture_.Get("G").At(x, y) = static_cast<float>(x);
      }
    }
    FillGaps(samples_, picture_.GetColor(""));
  }

  Plane samples_{9, 5};
  LayeredImage picture_ = [] {
    LayeredImage image(9, 5);
    image.AddColor("");
    return image;
  }();
};

TEST_F(FillGapsTest, WhatIsMissingIsLikeWhatIsAround) {
  Fill(4);
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 9; ++x) EXPECT_FLOAT_EQ(picture_.Get("R").At(x, y), 2) << x << ' ' << y;
    EXPECT_EQ(picture_.Get("G").At(3, y), 3) << "what has samples stays";
    EXPECT_GT(picture_.Get("G").At(4, y), 1.5f) << "nearer to the right end of it";
    EXPECT_LE(picture_.Get("G").At(8, y), picture_.Get("G").At(4, y));
    EXPECT_EQ(picture_.Get("B").At(8, y), 0);
  }
}

TEST_F(FillGapsTest, AWholePictureStaysAndSoDoesAnEmptyOne) {
  Fill(0);
  EXPECT_EQ(picture_.Get("R").At(8, 4), 0);
  Fill(9);
  EXPECT_EQ(picture_.Get("G").At(8, 4), 8);
}

TEST_F(FillGapsTest, OnePixelIsEnough) {
  samples_.At(8, 4) = 1;
  picture_.Get("B").At(8, 4) = 7;
  Fill(0);
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 9; ++x) EXPECT_FLOAT_EQ(picture_.Get("B").At(x, y), 7);
  }
}

}  // namespace
}  // namespace lumifold::server
