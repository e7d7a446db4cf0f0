#include "client/pictures/exposure.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "filter/image/layered_image.h"

namespace lumifold::pictures {
namespace {

/// Grey, with the upper `bright_rows` of 10 rows brighter.
LayeredImage GreyPicture(float value, float bright, int bright_rows) {
  LayeredImage image(8, 10);
  for (const FloatView& channel : image.AddColor("")) {
    for (int y = 0; y < 10; ++y) {
      for (int x = 0; x < 8; ++x) channel.At(x, y) = y < bright_rows ? bright : value;
    }
  }
  return image;
}

float ExposureOf(const LayeredImage& image, float white = 1) {
  return AutomaticExposure(image.GetColor(""), white);
}

TEST(AutomaticExposure, MakesGreyOfTheMean) {
  EXPECT_NEAR(ExposureOf(GreyPicture(0.02f, 0, 0)), 9, 1e-4);
  EXPECT_NEAR(ExposureOf(GreyPicture(20, 0, 0)), 0.009, 1e-6);
}

TEST(AutomaticExposure, DoesNotClipABrightSky) {
  const LayeredImage sky = GreyPicture(0.05f, 40, 6);
  EXPECT_NEAR(ExposureOf(sky) * 40, 1, 1e-4);
  EXPECT_NEAR(ExposureOf(GreyPicture(0.001f, 40, 6), 5.6f) * 40, 5.6, 0.1);
}

TEST(AutomaticExposure, IgnoresALampAndWhatIsNoNumber) {
  LayeredImage lamp = GreyPicture(0.18f, 0, 0);
  for (const FloatView& channel : lamp.GetColor("")) {
    channel.At(0, 0) = 1000;
    channel.At(1, 0) = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_NEAR(ExposureOf(lamp), 1, 0.15);
}

TEST(AutomaticExposure, OfABlackPictureIsOne) { EXPECT_EQ(ExposureOf(GreyPicture(0, 0, 0)), 1); }

}  // namespace
}  // namespace lumifold::pictures
