#include "filter/denoise/picture_size.h"

#include <gtest/gtest.h>

namespace lumifold::filter {
namespace {

TEST(PictureSize, LeavesSmallPicturesAsTheyAre) {
  for (const int side : {1, 8, 64, 128}) EXPECT_EQ(ReachScale(side, side), 1) << side;
  EXPECT_EQ(SigmaNormal(1, 1), kSigmaNormal);
  EXPECT_EQ(SigmaNormal(256, 192), kSigmaNormal);
}

TEST(PictureSize, ReachesFartherAmongNearerNormalsInFinerPictures) {
  EXPECT_FLOAT_EQ(ReachScale(512, 512), 2);
  EXPECT_NEAR(SigmaNormal(1024, 768), kSigmaNormal / 1.4142f, 1e-4f);
}

TEST(PictureSize, EndsWhereMeasurementsDo) {
  EXPECT_EQ(ReachScale(16384, 8192), ReachScale(1024, 1024));
  EXPECT_EQ(SigmaNormal(1472, 1472), SigmaNormal(1024, 1024));
}

}  // namespace
}  // namespace lumifold::filter
