#include "worker/render/lights/studio.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filter/image/planes.h"

namespace lumifold::render {
namespace {

/// The radiance that a white diffuse surface of this normal reflects.
double WhiteFacing(scene::Vec3 normal) {
  constexpr int kStudioSteps = 64;
  constexpr double kPiDouble = 3.14159265358979;
  double sum = 0;
  for (int i = 0; i < kStudioSteps; ++i) {
    for (int j = 0; j < 2 * kStudioSteps; ++j) {
      const double polar = kPiDouble * (i + 0.5) / kStudioSteps,
                   azimuth = kPiDouble * (j + 0.5) / kStudioSteps;
      const scene::Vec3 direction = {static_cast<float>(std::sin(polar) * std::cos(azimuth)),
                                     static_cast<float>(std::cos(polar)),
                                     static_cast<float>(std::sin(polar) * std::sin(azimuth))};
      const double cosine = std::max(0.0, static_cast<double>(Dot(direction, normal)));
      const double radiance = static_cast<double>(StudioEnvironment()->Radiance(direction).y);
      sum += radiance * cosine * std::sin(polar) * (kPiDouble / kStudioSteps) * (kPiDouble / kStudioSteps);
    }
  }
  return sum / kPiDouble;
}

TEST(Studio, ShowsWhiteAboutAsBrightAsPaperAndTurnedAwayDarker) {
  EXPECT_NEAR(WhiteFacing({0, 0, 1}), 0.8, 0.05) << "the front";
  EXPECT_NEAR(WhiteFacing({0, 1, 0}), 1.24, 0.05);
  EXPECT_GT(WhiteFacing({-1, 0, 0}), WhiteFacing({1, 0, 0})) << "the key light is at the left";
  EXPECT_LT(WhiteFacing({0, -1, 0}), 0.4);
}

TEST(Studio, IsGreyAndHasNoSeam) {
  const LayeredImage picture = StudioPicture();
  const ConstColorView color = picture.GetColor("");
  float largest_step = 0;
  ForEachPixel(picture.width(), picture.height(), [&](int x, int y) {
    const float value = color[0].At(x, y);
    EXPECT_GT(value, 0.1f);
    EXPECT_EQ(color[1].At(x, y), value);
    EXPECT_EQ(color[2].At(x, y), value);
    const float right = color[0].At((x + 1) % picture.width(), y);
    largest_step = std::max(largest_step, std::abs(right - value));
  });
  EXPECT_LT(largest_step, 0.5f) << "soft edges, across the seam too";
}

}  // namespace
}  // namespace lumifold::render
