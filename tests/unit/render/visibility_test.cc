#include "worker/render/tracing/visibility.h"

#include <gtest/gtest.h>

#include <cstring>
#include <utility>

#include "filter/image/layers.h"
#include "filter/image/portable_math.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::render {
namespace {

using scene::AlphaMode;
using scene::Material;
using scene::Scene;
using scene::Vec3;

constexpr int kWallSize = 32;

Material Black(AlphaMode mode, float alpha) {
  Material material = testing::Lambert({0, 0, 0});
  material.alpha_mode = mode;
  material.base.alpha = alpha;
  return material;
}

/// An image of 2x2 texels without interpolation; the first and the last texel are opaque.
void AddCheckeredAlpha(Scene* scene, Material* material) {
  scene::ImageData image;
  image.width = image.height = 2;
  for (const uint8_t alpha : std::initializer_list<uint8_t>{255, 0, 0, 255})
    image.rgba.insert(image.rgba.end(), {255, 255, 255, alpha});
  scene->images = {std::make_shared<const scene::ImageData>(image)};
  scene->textures = {{.image = 0, .nearest = true}};
  material->base.color_texture.texture = 0;
}

/// A wide quad at height y that faces up.
scene::Mesh Layer(float y, float half, int material) {
  return testing::QuadMesh({-half, y, -half}, {0, 0, 2 * half}, {2 * half, 0, 0}, material);
}

/// The radiance that a camera above sees of a lamp through `layers` sheets of the material.
double SeenThrough(const Material& material, Scene scene, int layers) {
  scene.materials = {testing::Emitter({1, 1, 1}), material};
  testing::Place(&scene, Layer(0, 1.5f, 0));
  scene.meshes.push_back(Layer(0, 1, 1));
  for (int i = 0; i < layers; ++i) {
    scene::Instance sheet;
    sheet.mesh = 1;
    sheet.world_from_object.origin = {0, 1.0f + 0.1f * static_cast<float>(i), 0};
    scene.instances.push_back(sheet);
  }
  scene::Camera camera = testing::LookAt({0, 3, 0}, {0, 0, 0}, 1);
  camera.kind = scene::Camera::Kind::kOrthographic;
  camera.ymag = camera.xmag = 0.9f;
  scene.cameras = {camera};
  return MeanOf(RenderAll(*MakeRenderer(scene, SettingsOf(kWallSize, kWallSize)), kWallSize, kWallSize, 64),
                layers::kNoisy);
}

TEST(Alpha, MasksHaveHoles) {
  Scene scene;
  Material mask = Black(AlphaMode::kMask, 1);
  AddCheckeredAlpha(&scene, &mask);
  EXPECT_NEAR(SeenThrough(mask, scene, 1), 0.5, 5e-3);
  EXPECT_NEAR(SeenThrough(mask, scene, 3), 0.5, 5e-3);
  mask.alpha_mode = AlphaMode::kOpaque;
  EXPECT_EQ(SeenThrough(mask, scene, 1), 0);
}

TEST(Alpha, MasksAreAllOrNothing) {
  EXPECT_EQ(SeenThrough(Black(AlphaMode::kMask, 0.49f), {}, 1), 1);
  EXPECT_EQ(SeenThrough(Black(AlphaMode::kMask, 0.5f), {}, 1), 0);
}

TEST(Alpha, BlendedLayersMultiplyTheirTransmittances) {
  EXPECT_NEAR(SeenThrough(Black(AlphaMode::kBlend, 0.3f), {}, 1), 0.7, 5e-3);
  EXPECT_NEAR(SeenThrough(Black(AlphaMode::kBlend, 0.3f), {}, 2), 0.49, 5e-3);
  EXPECT_NEAR(SeenThrough(Black(AlphaMode::kBlend, 0.3f), {}, 5), 0.168, 5e-3);
}

/// A white floor under a directional light and `layers` sheets, seen from below the sheets.
double SunThrough(const Material& material, Scene scene, int layers) {
  scene.materials = {testing::Lambert({1, 1, 1}), material};
  testing::Place(&scene, Layer(0, 1, 0));
  for (int i = 0; i < layers; ++i) testing::Place(&scene, Layer(2.0f + 0.1f * static_cast<float>(i), 20, 1));
  scene::PunctualLight sun;
  sun.kind = scene::PunctualLight::Kind::kDirectional;
  sun.intensity = 683 * kPi;
  sun.world_from_light = testing::LookAt({0, 10, 0}, {0, 0, 0}, 1).world_from_camera;
  scene.lights = {sun};
  scene.cameras = {testing::LookAt({0, 1, 0}, {0, 0, 0}, 0.8f)};
  return MeanOf(RenderAll(*MakeRenderer(scene, SettingsOf(kWallSize, kWallSize, 0)), kWallSize, kWallSize, 4),
                layers::kDirect);
}

TEST(Alpha, ShadowsHaveTheOpacityOfTheirSurfaces) {
  const double free = SunThrough(Black(AlphaMode::kBlend, 0.4f), {}, 0);
  EXPECT_GT(free, 0.9);
  EXPECT_NEAR(SunThrough(Black(AlphaMode::kBlend, 0.4f), {}, 1), 0.6 * free, 1e-5);
  EXPECT_NEAR(SunThrough(Black(AlphaMode::kBlend, 0.4f), {}, 3), 0.216 * free, 1e-5);
  EXPECT_EQ(SunThrough(Black(AlphaMode::kMask, 0.4f), {}, 1), free);
  EXPECT_EQ(SunThrough(Black(AlphaMode::kMask, 0.6f), {}, 1), 0);
}

TEST(Alpha, CoincidentSheetsEachAttenuate) {
  Scene scene;
  scene.materials = {testing::Lambert({1, 1, 1}), Black(AlphaMode::kBlend, 0.5f)};
  for (int i = 0; i < 3; ++i) testing::Place(&scene, Layer(1, 4, 1));
  for (int i = 0; i < 17; ++i) testing::Place(&scene, Layer(5.0f + 0.1f * static_cast<float>(i % 9), 4, 1));
  const auto embree = *EmbreeScene::Create(scene);
  const TextureSampler textures(scene);
  const SurfaceReader surfaces(scene, textures);
  const AlbedoTable albedos;
  const Visibility visibility(scene, *embree, surfaces, albedos);
  EXPECT_EQ(
      visibility.Transmittance({{.origin = {0.3f, 0, 0.1f}, .direction = {0, 1, 0}, .max_distance = 4}}).x,
      0.125f);
  EXPECT_EQ(visibility.Transmittance({{.origin = {0.3f, 0, 0.1f}, .direction = {0, 1, 0}}}).x, 0x1p-20f);
  EXPECT_EQ(
      visibility.Transmittance({{.origin = {0.3f, 0, 0.1f}, .direction = {0, 1, 0}, .max_distance = 0.5f}}).x,
      1);
}

/// A floor lit by a square light above it, with `sheet` as an additional material.
struct Floor {
  Scene scene;

  Floor(Material light, const Material& sheet) {
    light.double_sided = true;
    scene.materials = {testing::Lambert({0.8f, 0.8f, 0.8f}), std::move(light), sheet};
    testing::Place(&scene, Layer(0, 3, 0));
    testing::Place(&scene, Layer(2, 0.5f, 1));
    scene.cameras = {testing::LookAt({0, 0.9f, 2.5f}, {0, 0, 0}, 0.7f)};
  }
  double Mean(LightStrategy strategy, uint32_t spp) const {
    const auto renderer = MakeRenderer(scene, SettingsOf(kWallSize, kWallSize, 4), strategy);
    return MeanOf(RenderAll(*renderer, kWallSize, kWallSize, spp), layers::kNoisy);
  }
  void ExpectStrategiesAgree() const {
    const double sampled = Mean(LightStrategy::kLightSamples, 256);
    EXPECT_GT(sampled, 0.01);
    EXPECT_NEAR(Mean(LightStrategy::kBsdfHits, 4096), sampled, 0.015 * sampled);
    EXPECT_NEAR(Mean(LightStrategy::kCombined, 256), sampled, 0.01 * sampled);
  }
};

TEST(Alpha, HalfTransparentLightsAgreeBySampleAndByHit) {
  Material light = testing::Emitter({4, 4, 4});
  const double opaque = Floor(light, {}).Mean(LightStrategy::kLightSamples, 64);
  light.alpha_mode = AlphaMode::kBlend;
  light.base.alpha = 0.4f;
  const Floor floor(light, {});
  floor.ExpectStrategiesAgree();
  EXPECT_NEAR(floor.Mean(LightStrategy::kLightSamples, 64), 0.4 * opaque, 0.02 * opaque);
}

Material ClearPane() {
  Material pane;
  pane.base.color = {0.9f, 0.9f, 0.9f};
  pane.base.metallic = 0;
  pane.base.roughness = 0;
  pane.transmission.factor = 1;
  pane.double_sided = true;
  return pane;
}

TEST(ThinGlass, TransmitsLightSamplesAndHitsEqually) {
  Floor floor(testing::Emitter({4, 4, 4}), ClearPane());
  const double open = floor.Mean(LightStrategy::kLightSamples, 64);
  testing::Place(&floor.scene, Layer(1.5f, 3, 2));
  floor.ExpectStrategiesAgree();
  EXPECT_LT(floor.Mean(LightStrategy::kLightSamples, 64), 0.95 * open);
}

TEST(ThinGlass, AttenuatesDirectionalLightByItsTransmittance) {
  const double free = SunThrough(ClearPane(), {}, 0);
  // At normal incidence each face of ior 1.5 reflects 4 %; both together reflect 2 F / (1 + F).
  const double transmittance = 0.9 * (1 - 2 * 0.04 / 1.04);
  EXPECT_NEAR(SunThrough(ClearPane(), {}, 1), transmittance * free, 1e-4);
  EXPECT_NEAR(SunThrough(ClearPane(), {}, 2), transmittance * transmittance * free, 1e-4);
  Material rough = ClearPane();
  rough.base.roughness = 0.5f;
  EXPECT_EQ(SunThrough(rough, {}, 1), 0);
}

TEST(Alpha, IsIndependentOfTilesAndPasses) {
  Scene scene = testing::SmallRoom();
  scene.materials[4].alpha_mode = AlphaMode::kBlend;
  scene.materials[4].base.alpha = 0.5f;
  const auto renderer = MakeRenderer(scene, SettingsOf(24, 18));
  RenderCounts counts;
  const LayeredImage whole = renderer->RenderPass({0, 0, 24, 18}, 0, {2, 6}, &counts).pixels;
  const Rect tile = {5, 3, 17, 16};
  const LayeredImage part = renderer->RenderPass(tile, 0, {2, 6}, &counts).pixels;
  for (const LayeredImage::Channel& channel : part.channels()) {
    const ConstFloatView cut = whole.Get(channel.name).Crop(tile);
    for (int y = 0; y < tile.height(); ++y) {
      const size_t bytes = sizeof(float) * static_cast<size_t>(tile.width());
      EXPECT_EQ(std::memcmp(cut.Row(y), channel.plane.Row(y), bytes), 0) << channel.name << " row " << y;
    }
  }
}

}  // namespace
}  // namespace lumifold::render
