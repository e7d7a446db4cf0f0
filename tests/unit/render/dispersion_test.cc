#include "worker/render/materials/dispersion.h"

#include <gtest/gtest.h>

#include <cmath>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/materials/microfacet.h"

namespace lumifold::render {
namespace {

constexpr float kPrismIor = 1.5f;
constexpr float kPrismDispersion = 2;  // an Abbe number of 10

TEST(Dispersion, SpreadsTheIndexByTheAbbeNumber) {
  const float abbe = 40;
  const float f_minus_c = DispersedIor(1.6f, 20 / abbe, 1) - DispersedIor(1.6f, 20 / abbe, -1);
  EXPECT_NEAR(f_minus_c, 0.6f / abbe, 1e-6f);
  EXPECT_EQ(DispersedIor(1.6f, 0.5f, 0), 1.6f);
  EXPECT_EQ(DispersedIor(1.6f, 0, 1), 1.6f);
  EXPECT_EQ(DispersedIor(1.1f, 100, -1), 1);
}

TEST(Dispersion, GivesEachChannelItsIndexOnAverage) {
  constexpr int kNumbers = 30000;
  double mean[3] = {};
  double shift[3] = {};
  for (int i = 0; i < kNumbers; ++i) {
    const Wavelength w = Wavelength::Sample((static_cast<float>(i) + 0.5f) / kNumbers);
    EXPECT_LE(std::abs(w.shift), kMaxShift);
    EXPECT_NEAR(w.weight.x + w.weight.y + w.weight.z, 3, 1e-3f);
    for (int c = 0; c < 3; ++c) {
      mean[c] += double{w.weight[c]} / kNumbers;
      shift[c] += double{w.weight[c]} * double{w.shift} / kNumbers;
    }
  }
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(mean[c], 1, 1e-3) << c;
    EXPECT_NEAR(shift[c], c - 1, 1e-3) << c;
  }
  EXPECT_TRUE(std::isfinite(Wavelength::Sample(0).weight.x));
}

scene::Material DispersiveGlass(float roughness) {
  scene::Material glass;
  glass.base.metallic = 0;
  glass.base.roughness = roughness;
  glass.transmission.factor = 1;
  glass.volume.is_solid = true;
  glass.ior = kPrismIor;
  glass.volume.dispersion = kPrismDispersion;
  return glass;
}

TEST(Dispersion, KeepsAWhiteFurnaceWhite) {
  for (const float roughness : {0.0f, 0.4f}) {
    const auto renderer = MakeRenderer(testing::Furnace(DispersiveGlass(roughness)), SettingsOf(16, 16, 64));
    const LayeredImage image = RenderAll(*renderer, 16, 16, 1024);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(MeanOf(image, layers::kNoisy, c), 1, 0.01) << roughness << " " << c;
  }
}

// The prism's front is z = 0. Its back falls away from the viewer with x, at this angle.
constexpr double kPrismAngle = 0.5;
constexpr double kThickness = 0.2;  // at x = -1
constexpr double kWall = -3;        // z of a wall that shines where x > kEdge
constexpr double kEdge = 0.7;

scene::Scene PrismBeforeAnEdge() {
  scene::Scene scene;
  scene.materials = {DispersiveGlass(0), testing::Emitter({1, 1, 1})};
  const auto back = [](float x) {
    return static_cast<float>(-kThickness - (double{x} + 1) * std::tan(kPrismAngle));
  };
  constexpr float kHigh = 5;
  const auto place = [&scene](scene::Vec3 origin, scene::Vec3 a, scene::Vec3 b) {
    testing::Place(&scene, testing::QuadMesh(origin, a, b, 0));
  };
  place({-1, -kHigh, 0}, {2, 0, 0}, {0, 2 * kHigh, 0});
  place({-1, -kHigh, back(-1)}, {0, 2 * kHigh, 0}, {2, 0, back(1) - back(-1)});
  place({-1, -kHigh, back(-1)}, {0, 0, -back(-1)}, {0, 2 * kHigh, 0});
  place({1, -kHigh, 0}, {0, 0, back(1)}, {0, 2 * kHigh, 0});
  testing::Place(&scene, testing::QuadMesh({static_cast<float>(kEdge), -50, static_cast<float>(kWall)},
                                           {50, 0, 0}, {0, 100, 0}, 1));
  scene.cameras = {testing::LookAt({0, 0, 5}, {0, 0, 0}, 1)};
  scene.cameras[0].kind = scene::Camera::Kind::kOrthographic;
  scene.cameras[0].xmag = scene.cameras[0].ymag = 0.5f;
  return scene;
}

/// What the camera sees in light for which the prism has this index: the part of x in [-1/2, 1/2] from which
/// rays reach the shining part of the wall, times the transmittance of both faces.
double SeenThroughThePrism(double ior) {
  const double bent = std::asin(ior * std::sin(kPrismAngle)) - kPrismAngle;  // towards +x
  // x + (depth of the wall behind the back at x) tan(bent) = kEdge
  const double slope = std::tan(kPrismAngle);
  const double t = std::tan(bent);
  const double x = (kEdge - (-kWall - kThickness - slope) * t) / (1 - slope * t);
  float cosine = 0;
  const float front = DielectricFresnel(1, static_cast<float>(ior), &cosine);
  const float rear =
      DielectricFresnel(static_cast<float>(std::cos(kPrismAngle)), static_cast<float>(1 / ior), &cosine);
  return (0.5 - x) * double{(1 - front) * (1 - rear)};
}

TEST(Dispersion, PrismsBendEachChannelByItsIndex) {
  const auto renderer = MakeRenderer(PrismBeforeAnEdge(), SettingsOf(16, 16, 1));
  const LayeredImage image = RenderAll(*renderer, 16, 16, 4096);
  double expected[3] = {};
  for (int c = 0; c < 3; ++c) {
    expected[c] =
        SeenThroughThePrism(double{DispersedIor(kPrismIor, kPrismDispersion, static_cast<float>(c - 1))});
    EXPECT_NEAR(MeanOf(image, layers::kNoisy, c), expected[c], 0.01) << c;
  }
  EXPECT_GT(std::abs(expected[0] - expected[2]), 0.05);
}

}  // namespace
}  // namespace lumifold::render
