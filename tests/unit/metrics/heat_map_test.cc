#include "filter/metrics/heat_map.h"

#include <gtest/gtest.h>

#include "filter/image/color.h"
#include "filter/image/layered_image.h"
#include "filter/metrics/metrics.h"
#include "tests/unit/metrics/color_of.h"

namespace lumifold::metrics {
namespace {

Plane Ramp(int width, float top) {
  Plane plane(width, 1);
  for (int x = 0; x < width; ++x)
    plane.At(x, 0) = top * static_cast<float>(x) / static_cast<float>(width - 1);
  return plane;
}

TEST(HeatMap, GetsLighterAllTheWay) {
  const Plane ramp = Ramp(256, 7.0f);
  const Picture map = HeatMap(ramp.view(), 7.0f);
  float last = -1;
  for (int x = 0; x < 256; ++x) {
    const float light = Luminance(map[0].At(x, 0), map[1].At(x, 0), map[2].At(x, 0));
    EXPECT_GT(light, last) << "at " << x;
    last = light;
  }
  EXPECT_GT(last, 0.8f);
}

TEST(HeatMap, ClampsToItsScale) {
  const Plane values = Ramp(3, 10.0f);  // 0, 5, 10
  const Picture map = HeatMap(values.view(), 5.0f);
  for (size_t c = 0; c < 3; ++c) EXPECT_EQ(map[c].At(1, 0), map[c].At(2, 0));
}

TEST(HeatScale, IsARoundNumberThatFewValuesPass) {
  EXPECT_EQ(HeatScale(Ramp(100, 3.2f).view()), 5.0f);
  EXPECT_EQ(HeatScale(Ramp(100, 2.0f).view()), 2.0f);
  EXPECT_EQ(HeatScale(Ramp(100, 70.0f).view()), 100.0f);
  EXPECT_FLOAT_EQ(HeatScale(Ramp(100, 0.013f).view()), 0.02f);
  EXPECT_EQ(HeatScale(Plane(4, 4).view()), 1.0f);
  Plane outlier(2000, 1);
  outlier.Fill(0.9f);
  outlier.At(7, 0) = 1e6f;
  EXPECT_EQ(HeatScale(outlier.view()), 1.0f);
}

TEST(StepErrors, SquareToMse255) {
  LayeredImage a(2, 1);
  LayeredImage b(2, 1);
  for (LayeredImage* image : {&a, &b}) image->AddColor("");
  a.Get("R").At(0, 0) = 0.5f;
  a.Get("B").At(1, 0) = 0.1f;
  b.Get("G").At(1, 0) = 0.7f;
  const Plane errors = StepErrors(ColorOf(a), ColorOf(b));
  const float mean = (errors.At(0, 0) * errors.At(0, 0) + errors.At(1, 0) * errors.At(1, 0)) / 2;
  EXPECT_NEAR(mean, Mse255(ColorOf(a), ColorOf(b)), 0.01);
}

}  // namespace
}  // namespace lumifold::metrics
