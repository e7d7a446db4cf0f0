// Pictures with a transparent background, and surfaces that show shadows alone.

#include <gtest/gtest.h>

#include <memory>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using scene::Vec3;

constexpr int kSizeOfPicture = 8;

std::shared_ptr<const Environment> Sky(float radiance) {
  LayeredImage picture(8, 4);
  for (const FloatView& channel : picture.AddColor("")) {
    for (int y = 0; y < 4; ++y) {
      for (int x = 0; x < 8; ++x) channel.At(x, y) = radiance;
    }
  }
  return *Environment::Create(picture, 0, 1);
}

RenderSettings Transparent() {
  RenderSettings settings = SettingsOf(kSizeOfPicture, kSizeOfPicture);
  settings.is_transparent = true;
  return settings;
}

/// The sum of a channel over all pixels.
double Sum(const LayeredImage& image, std::string_view name) {
  double sum = 0;
  for (int y = 0; y < kSizeOfPicture; ++y) {
    for (int x = 0; x < kSizeOfPicture; ++x) sum += static_cast<double>(image.Get(name).At(x, y));
  }
  return sum;
}

/// The part of the light that does not arrive, of all pixels.
double ShadowIn(const LayeredImage& image) {
  return (Sum(image, layers::kCatcherShadow[0]) + Sum(image, layers::kCatcherShadow[1])) /
         (Sum(image, layers::kCatcherLight[0]) + Sum(image, layers::kCatcherLight[1]));
}

/// A ball of radius 1/2 whose centre is `height` above the origin of a ground at y = 0.
scene::Scene BallOverGround(float height) {
  scene::Scene scene;
  scene.materials.push_back(testing::Lambert({0.5f, 0.5f, 0.5f}));
  testing::Place(&scene, testing::SphereMesh(0.5f, 24, 0));
  scene.instances[0].world_from_object.origin = {0, height, 0};
  scene.catchers.push_back({1, {}, "ground"});
  scene.meshes.push_back(testing::QuadMesh({-50, 0, 50}, {100, 0, 0}, {0, 0, -100}, scene::kNone));
  return scene;
}

TEST(Transparent, LeavesOutTheSkyThatTheCameraSees) {
  scene::Scene scene = BallOverGround(0);
  scene.catchers.clear();
  scene.cameras = {testing::LookAt({0, 0, 3}, {0, 0, 0}, 0.5f)};
  RenderSettings settings = SettingsOf(kSizeOfPicture, kSizeOfPicture);
  settings.environment = Sky(2);
  const LayeredImage opaque = RenderAll(*MakeRenderer(scene, settings), kSizeOfPicture, kSizeOfPicture, 16);
  settings.is_transparent = true;
  const auto renderer = MakeRenderer(scene, settings);
  const LayeredImage clear = RenderAll(*renderer, kSizeOfPicture, kSizeOfPicture, 16);
  EXPECT_FALSE(opaque.Has(layers::kOpacity));
  int partly = 0;
  for (int y = 0; y < kSizeOfPicture; ++y) {
    for (int x = 0; x < kSizeOfPicture; ++x) {
      const float covered = clear.Get(layers::kOpacity).At(x, y);
      partly += covered > 0 && covered < 16 ? 1 : 0;
      const auto sum = [&](const LayeredImage& image) {
        return image.GetColor(layers::HalfA(layers::kNoisy))[1].At(x, y) +
               image.GetColor(layers::HalfB(layers::kNoisy))[1].At(x, y);
      };
      EXPECT_NEAR(sum(clear) + 2 * (16 - covered), sum(opaque), 1e-4f);
    }
  }
  EXPECT_GT(partly, 8);
  const EdgedImage geometry = renderer->RenderGeometry({0, 0, kSizeOfPicture, kSizeOfPicture}, 0);
  EXPECT_EQ(Sum(geometry.pixels, layers::kAlpha) > 0, true);
  for (int row = 0; row < geometry.edges.height(); ++row) {
    for (int i = 0; i < kSubSamples; ++i) EXPECT_EQ(geometry.edges.Get("emission.G").At(i, row), 0);
  }
}

TEST(Transparent, GlassShowsTheSkyBehindIt) {
  scene::Scene scene = BallOverGround(0);
  scene.catchers.clear();
  scene.materials[0].transmission.factor = 1;
  scene.materials[0].base.roughness = 0;
  scene.cameras = {testing::LookAt({0, 0, 3}, {0, 0, 0}, 0.1f)};
  RenderSettings settings = Transparent();
  settings.environment = Sky(2);
  const LayeredImage image = RenderAll(*MakeRenderer(scene, settings), kSizeOfPicture, kSizeOfPicture, 16);
  EXPECT_EQ(Sum(image, layers::kOpacity), 16 * kSizeOfPicture * kSizeOfPicture);
  EXPECT_GT(MeanOf(image, layers::kNoisy), 0.3);
}

TEST(ShadowCatcher, HasTheShadowOfABallInADome) {
  // Under a sky of one radiance a ball of radius r takes (r/h)^2 of the light of a point h below its centre.
  for (const float height : {0.75f, 1.0f, 2.0f}) {
    scene::Scene scene = BallOverGround(height);
    scene.cameras = {testing::LookAt({2, 0.3f, 0}, {0, 0, 0}, 0.002f)};
    RenderSettings settings = Transparent();
    settings.environment = Sky(3);
    const LayeredImage image = RenderAll(*MakeRenderer(scene, settings), kSizeOfPicture, kSizeOfPicture, 256);
    EXPECT_EQ(Sum(image, layers::kCatcher), 256 * kSizeOfPicture * kSizeOfPicture);
    EXPECT_EQ(Sum(image, layers::kOpacity), 0);
    EXPECT_EQ(MeanOf(image, layers::kNoisy), 0);
    EXPECT_NEAR(ShadowIn(image), 0.25 / static_cast<double>(height * height), 0.01) << height;
  }
}

TEST(ShadowCatcher, HasTheSharpShadowOfALamp) {
  for (const float x : {0.0f, 3.0f}) {  // below the ball, and far from it
    scene::Scene scene = BallOverGround(1);
    scene::PunctualLight lamp;
    lamp.intensity = 100;
    lamp.world_from_light.origin = {0, 4, 0};
    scene.lights.push_back(lamp);
    scene.cameras = {testing::LookAt({x + 1, 0.2f, 0}, {x, 0, 0}, 0.02f)};
    const LayeredImage image =
        RenderAll(*MakeRenderer(scene, Transparent()), kSizeOfPicture, kSizeOfPicture, 4);
    EXPECT_EQ(ShadowIn(image), x == 0 ? 1 : 0);
  }
}

TEST(ShadowCatcher, HidesWhatIsBehindItAndChangesNoLight) {
  scene::Scene scene = BallOverGround(-2);
  scene.cameras = {testing::LookAt({0, 3, 0}, {0, 0, 0}, 0.1f)};
  RenderSettings settings = Transparent();
  settings.environment = Sky(1);
  const auto from_above = MakeRenderer(scene, settings);
  EXPECT_EQ(Sum(RenderAll(*from_above, kSizeOfPicture, kSizeOfPicture, 4), layers::kOpacity), 0);
  EXPECT_EQ(Sum(from_above->RenderGeometry({0, 0, kSizeOfPicture, kSizeOfPicture}, 0).pixels, layers::kAlpha),
            0);

  scene = BallOverGround(1);
  scene.cameras = {testing::LookAt({0, 1, 3}, {0, 1, 0}, 0.1f)};
  const LayeredImage with = RenderAll(*MakeRenderer(scene, settings), kSizeOfPicture, kSizeOfPicture, 4);
  scene.catchers.clear();
  ExpectSameBits(with, RenderAll(*MakeRenderer(scene, settings), kSizeOfPicture, kSizeOfPicture, 4));
}

}  // namespace
}  // namespace lumifold::render
