#include "worker/render/lights/environment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "filter/image/color.h"
#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using scene::Vec2;
using scene::Vec3;
using ::testing::HasSubstr;

LayeredImage SkyPicture(int width, int height, float value) {
  LayeredImage picture(width, height);
  for (const FloatView& channel : picture.AddColor("")) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) channel.At(x, y) = value;
    }
  }
  return picture;
}

/// A dim picture with a strong gradient and a small bright sun on the upper right.
LayeredImage SunnyPicture() {
  LayeredImage picture = SkyPicture(32, 16, 0.2f);
  const ColorView color = picture.GetColor("");
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 32; ++x) color[2].At(x, y) += 0.05f * static_cast<float>(x);
  }
  for (int c = 0; c < 3; ++c) color[c].At(21, 4) = 300;
  return picture;
}

std::shared_ptr<const Environment> Make(const LayeredImage& picture, float rotate = 0, float scale = 1) {
  auto environment = Environment::Create(picture, rotate, scale);
  EXPECT_TRUE(environment.ok()) << environment.status();
  return *environment;
}

Vec2 GridPoint(int i, int n) {
  return {(static_cast<float>(i % n) + 0.5f) / static_cast<float>(n),
          (static_cast<float>(i / n) + 0.5f) / static_cast<float>(n)};
}

/// Directions distributed uniformly over the sphere.
Vec3 EvenDirection(Vec2 u) {
  const double y = 1 - 2 * static_cast<double>(u.y);
  const double radius = std::sqrt(1 - y * y);
  const double phi = 2 * M_PI * static_cast<double>(u.x);
  return {static_cast<float>(radius * std::cos(phi)), static_cast<float>(y),
          static_cast<float>(radius * std::sin(phi))};
}

TEST(Environment, PictureHasTheDocumentedOrientation) {
  struct Case {
    int x;
    int y;
    float rotate;
    Vec3 direction;
  };
  const float r = std::sqrt(0.5f);
  for (const Case& c : {Case{4, 2, 0, {1, 0, 0}}, Case{6, 2, 0, {0, 0, 1}}, Case{2, 2, 0, {0, 0, -1}},
                        Case{0, 2, 0, {-1, 0, 0}}, Case{4, 2, 90, {0, 0, -1}}, Case{4, 2, -90, {0, 0, 1}},
                        Case{4, 1, 0, {r, r, 0}}}) {
    LayeredImage picture = SkyPicture(8, 4, 0);
    picture.Get("R").At(c.x, c.y) = 1;
    // Texture coordinates name a texel's upper left corner, half a texel from its centre.
    const auto environment = Make(picture, c.rotate);
    EXPECT_GT(environment->Radiance(c.direction).x, 0.2f) << c.x << "," << c.y << " " << c.rotate;
    EXPECT_EQ(environment->Radiance(-c.direction).x, 0.0f) << c.x << "," << c.y << " " << c.rotate;
  }
}

TEST(Environment, ScaleIsAFactor) {
  EXPECT_FLOAT_EQ(Make(SkyPicture(4, 2, 2), 0, 1.5f)->Radiance({0, 1, 0}).y, 3);
}

TEST(Environment, DensityIntegratesToOne) {
  const auto environment = Make(SunnyPicture(), 33);
  constexpr int kGrid = 1024;
  double sum = 0;
  for (int i = 0; i < kGrid * kGrid; ++i)
    sum += static_cast<double>(environment->Density(EvenDirection(GridPoint(i, kGrid))));
  EXPECT_NEAR(sum * 4 * M_PI / (kGrid * kGrid), 1, 5e-3);
}

TEST(Environment, SamplesAgreeWithRadianceAndDensity) {
  const auto environment = Make(SunnyPicture(), -71);
  constexpr int kGrid = 256;
  double fluence = 0;
  int differing = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const EnvironmentSample sample = environment->Sample(GridPoint(i, kGrid));
    ASSERT_NEAR(Length(sample.direction), 1, 1e-5);
    ASSERT_GT(sample.pdf, 0);
    const Vec3 radiance = environment->Radiance(sample.direction);
    ASSERT_NEAR(radiance.x, sample.radiance.x, 5e-3f * (1 + radiance.x));
    // At the boundary of two texels rounding may give the neighbour's density.
    if (std::abs(environment->Density(sample.direction) - sample.pdf) > 1e-4f * sample.pdf) ++differing;
    fluence +=
        static_cast<double>(Luminance(sample.radiance.x, sample.radiance.y, sample.radiance.z) / sample.pdf);
  }
  EXPECT_LE(differing, kGrid * kGrid / 1000);
  EXPECT_NEAR(fluence / (kGrid * kGrid), environment->Fluence(), 5e-3 * environment->Fluence());
}

TEST(Environment, ImportanceSamplingAgreesWithUniformSampling) {
  const auto environment = Make(SunnyPicture(), 120);
  const Vec3 normal = Normalize(Vec3{0.3f, 0.8f, -0.4f});
  constexpr int kGrid = 1024;
  double uniform = 0;
  double important = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Vec3 direction = EvenDirection(GridPoint(i, kGrid));
    uniform +=
        4 * M_PI *
        static_cast<double>(environment->Radiance(direction).z * std::max(0.0f, Dot(direction, normal)));
    const EnvironmentSample sample = environment->Sample(GridPoint(i, kGrid));
    important +=
        static_cast<double>(sample.radiance.z * std::max(0.0f, Dot(sample.direction, normal)) / sample.pdf);
  }
  EXPECT_NEAR(important / uniform, 1, 3e-3);
}

TEST(Environment, ConstantLightIsSampledUniformly) {
  const auto environment = Make(SkyPicture(64, 32, 1));
  for (int i = 0; i < 64; ++i)
    EXPECT_NEAR(environment->Sample(GridPoint(i, 8)).pdf, 1 / (4 * M_PI), 1e-5) << i;
}

TEST(Environment, TreatsBadTexelsAsBlack) {
  LayeredImage picture = SkyPicture(4, 2, 1);
  picture.Get("G").At(0, 0) = std::numeric_limits<float>::quiet_NaN();
  picture.Get("R").At(1, 0) = std::numeric_limits<float>::infinity();
  picture.Get("B").At(2, 0) = -1;
  const auto environment = Make(picture);
  EXPECT_EQ(environment->bad_texels(), 3);
  EXPECT_TRUE(std::isfinite(environment->Fluence()));
  EXPECT_THAT(std::string(Environment::Create(SkyPicture(4, 2, 0), 0, 1).status().message()),
              HasSubstr("black"));
  EXPECT_FALSE(Environment::Create(LayeredImage(4, 2), 0, 1).ok());
  EXPECT_FALSE(Environment::Create(SkyPicture(4, 2, 1), std::nanf(""), 1).ok());
  EXPECT_FALSE(Environment::Create(SkyPicture(4, 2, 1), 0, 0).ok());
}

scene::Scene Ball(const scene::Material& material) {
  scene::Scene scene;
  scene.materials = {material};
  testing::Place(&scene, testing::SphereMesh(1, 24, 0));
  scene.cameras = {testing::LookAt({0, 0, 4}, {0, 0, 0}, 0.3f)};
  return scene;
}

TEST(Environment, WhiteBallIsInvisibleInWhiteLight) {
  RenderSettings settings = SettingsOf(16, 16);
  settings.environment = Make(SkyPicture(16, 8, 1));
  const LayeredImage image =
      RenderAll(*MakeRenderer(Ball(testing::Lambert({1, 1, 1})), settings), 16, 16, 256);
  EXPECT_NEAR(MeanOf(image, layers::kNoisy), 1, 2e-3);
  EXPECT_NEAR(MeanOf(image, layers::kDirect) + MeanOf(image, layers::kIndirect), 1, 2e-3);
}

TEST(Environment, BackgroundIsEmission) {
  RenderSettings settings = SettingsOf(8, 8);
  settings.environment = Make(SkyPicture(16, 8, 2));
  scene::Scene scene = Ball(testing::Lambert({1, 1, 1}));
  scene.cameras = {testing::LookAt({0, 0, 4}, {0, 0, 9}, 0.3f)};
  const auto renderer = MakeRenderer(scene, settings);
  const LayeredImage image = RenderAll(*renderer, 8, 8, 4);
  EXPECT_NEAR(image.GetColor(layers::kEmission)[0].At(3, 3), 4 * 2, 1e-5);  // a sum of four
  EXPECT_NEAR(MeanOf(image, layers::kNoisy), 2, 1e-5);
  EXPECT_EQ(image.GetColor(layers::kAlbedo)[0].At(3, 3), 0);
  const LayeredImage geometry = renderer->RenderGeometry({0, 0, 8, 8}, 0).pixels;
  EXPECT_EQ(geometry.Get(layers::kMask).At(3, 3), 0);
  EXPECT_EQ(geometry.Get(layers::kAlpha).At(3, 3), 0);
  EXPECT_TRUE(renderer->warnings().empty());
}

TEST(Environment, AllStrategiesConvergeToTheSamePicture) {
  scene::Material glossy = testing::Lambert({0.6f, 0.5f, 0.4f});
  glossy.specular.factor = 1;
  glossy.base.roughness = 0.4f;
  LayeredImage picture = SunnyPicture();
  for (const FloatView& channel : picture.GetColor("")) channel.At(21, 4) = 20;  // wide enough for hits
  RenderSettings settings = SettingsOf(12, 12);
  settings.environment = Make(picture, 60);
  double mean[3];
  for (const LightStrategy strategy :
       {LightStrategy::kCombined, LightStrategy::kLightSamples, LightStrategy::kBsdfHits}) {
    mean[static_cast<int>(strategy)] =
        MeanOf(RenderAll(*MakeRenderer(Ball(glossy), settings, strategy), 12, 12, 2048), layers::kNoisy);
  }
  EXPECT_NEAR(mean[1] / mean[0], 1, 5e-3);
  EXPECT_NEAR(mean[2] / mean[0], 1, 1e-2);
}

}  // namespace
}  // namespace lumifold::render
