#include "worker/render/renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::render {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<Renderer> MakeRenderer(scene::Scene scene, int width, int height, int max_bounces = 8) {
  return MakeRenderer(std::move(scene), SettingsOf(width, height, max_bounces));
}

TEST(Renderer, WhiteFurnaceHoldsForLambert) {
  const auto renderer = MakeRenderer(testing::Furnace(testing::Lambert({1, 1, 1})), 16, 16, 32);
  const LayeredImage image = RenderAll(*renderer, 16, 16, 256);
  EXPECT_NEAR(MeanOf(image, layers::kNoisy), 1, 2e-3);
  EXPECT_NEAR(MeanOf(image, layers::kDirect) + MeanOf(image, layers::kIndirect), 1, 2e-3);
}

TEST(Renderer, WhiteFurnaceHoldsForMirrorAndGlass) {
  scene::Material mirror;
  mirror.base.roughness = 0;
  EXPECT_NEAR(
      MeanOf(RenderAll(*MakeRenderer(testing::Furnace(mirror), 16, 16, 32), 16, 16, 64), layers::kNoisy), 1,
      1e-4);
  scene::Material glass = mirror;
  glass.base.metallic = 0;
  glass.transmission.factor = 1;
  glass.volume.is_solid = true;
  EXPECT_NEAR(
      MeanOf(RenderAll(*MakeRenderer(testing::Furnace(glass), 16, 16, 64), 16, 16, 256), layers::kNoisy), 1,
      5e-3);
}

TEST(Renderer, WhiteFurnaceHoldsForRoughMetalAndGlass) {
  for (const float roughness : {0.2f, 0.5f, 1.0f}) {
    scene::Material metal;
    metal.base.roughness = roughness;
    const auto mean = [](const scene::Material& material) {
      return MeanOf(RenderAll(*MakeRenderer(testing::Furnace(material), 16, 16, 64), 16, 16, 256),
                    layers::kNoisy);
    };
    EXPECT_NEAR(mean(metal), 1, 0.01) << roughness;
    scene::Material glass = metal;
    glass.base.metallic = 0;
    glass.transmission.factor = 1;
    EXPECT_NEAR(mean(glass), 1, 0.01) << "thin, " << roughness;
    glass.volume.is_solid = true;
    EXPECT_NEAR(mean(glass), 1, 0.01) << "solid, " << roughness;
  }
}

TEST(Renderer, CoatedWhiteLosesOnlySingleScatteringEnergy) {
  for (const float roughness : {0.0f, 0.3f, 0.6f, 1.0f}) {
    scene::Material plastic;
    plastic.base.metallic = 0;
    plastic.base.roughness = roughness;
    const LayeredImage image = RenderAll(*MakeRenderer(testing::Furnace(plastic), 16, 16, 32), 16, 16, 256);
    EXPECT_NEAR(MeanOf(image, layers::kNoisy), 1, 0.01) << roughness;
  }
}

/// A small patch under the centre of a square light of radiance 3, seen from above or below.
LayeredImage PatchUnderALight(const scene::Material& patch, bool from_above) {
  scene::Scene scene;
  scene.materials = {patch, testing::Emitter({3, 3, 3})};
  testing::Place(&scene, testing::QuadMesh({-5, 0, -5}, {0, 0, 10}, {10, 0, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-1, 2, -1}, {2, 0, 0}, {0, 0, 2}, 1));
  scene.cameras = {testing::LookAt({0, from_above ? 1.0f : -1.0f, 0}, {0, 0, 0}, 0.001f)};
  return RenderAll(*MakeRenderer(scene, 8, 8, 0), 8, 8, 1024);
}

/// Its irradiance over pi, from the form factors of four parallel rectangles.
double LightOnThePatch() {
  const double x = 0.5;  // half side over distance
  const double root = std::sqrt(1 + x * x);
  return 3 * 4 * (x / root * std::atan(x / root) * 2) / (2 * M_PI);
}

TEST(Renderer, DirectLightOfAQuadMatchesTheClosedForm) {
  const LayeredImage image = PatchUnderALight(testing::Lambert({0.5f, 0.5f, 0.5f}), true);
  EXPECT_NEAR(MeanOf(image, layers::kDirect), LightOnThePatch(), LightOnThePatch() * 2e-3);
  EXPECT_NEAR(MeanOf(image, layers::kNoisy), 0.5 * LightOnThePatch(), 3e-3);
}

TEST(Renderer, BackLitLeavesMatchTheClosedForm) {
  scene::Material leaf = testing::Lambert({0.5f, 0.5f, 0.5f});
  leaf.base.diffuse_transmission.factor = 0.75f;
  leaf.base.diffuse_transmission.color = {0.1f, 0.8f, 0.2f};
  const LayeredImage below = PatchUnderALight(leaf, false);
  for (int channel = 0; channel < 3; ++channel) {
    const double expected = 0.75 * double{leaf.base.diffuse_transmission.color[channel]} * LightOnThePatch();
    EXPECT_NEAR(MeanOf(below, layers::kNoisy, channel), expected, 3e-3) << channel;
  }
  EXPECT_EQ(MeanOf(below, layers::kDirect), 0);
  EXPECT_NEAR(MeanOf(PatchUnderALight(leaf, true), layers::kNoisy), 0.25 * 0.5 * LightOnThePatch(), 3e-3);
}

TEST(Renderer, SingleSidedLightsEmitFromTheirFrontOnly) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f}), testing::Emitter({3, 3, 3})};
  testing::Place(&scene, testing::QuadMesh({-5, 0, -5}, {0, 0, 10}, {10, 0, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-1, 2, -1}, {0, 0, 2}, {2, 0, 0}, 1));  // its front faces up
  scene.cameras = {testing::LookAt({0, 1, 0}, {0, 0, 0}, 0.5f)};
  EXPECT_EQ(MeanOf(RenderAll(*MakeRenderer(scene, 8, 8), 8, 8, 16), layers::kNoisy), 0);
  scene.materials[1].double_sided = true;
  EXPECT_GT(MeanOf(RenderAll(*MakeRenderer(scene, 8, 8), 8, 8, 16), layers::kNoisy), 0.1);
}

TEST(Renderer, PathsFromDarkSurfacesAreAsLongAsFromBrightOnes) {
  const auto rays_from = [](float albedo) {
    scene::Scene scene;
    scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f}), testing::Lambert({albedo, albedo, albedo}),
                       testing::Emitter({9, 9, 9})};
    testing::PlaceBoxInside(&scene, 2, {0, 0, 0, 0, 0, 0});
    testing::Place(&scene, testing::QuadMesh({-0.01f, -1.9f, -0.01f}, {0, 0, 0.02f}, {0.02f, 0, 0}, 1));
    testing::Place(&scene, testing::QuadMesh({-0.5f, 1.95f, -0.5f}, {1, 0, 0}, {0, 0, 1}, 2));
    scene.cameras = {testing::LookAt({0, -1, 0}, {0, -1.9f, 0}, 0.01f)};
    RenderCounts counts;
    MakeRenderer(scene, 8, 8)->RenderPass({0, 0, 8, 8}, 0, {0, 64}, &counts);
    return static_cast<double>(counts.rays) / static_cast<double>(counts.samples);
  };
  const double bright = rays_from(0.9f);
  EXPECT_GT(bright, 6.5) << "two bounces and the shadow rays of three surfaces; then some";
  EXPECT_NEAR(rays_from(0.05f), bright, 0.01);
}

TEST(Renderer, IsIndependentOfTilesAndPasses) {
  const auto renderer = MakeRenderer(testing::SmallRoom(), 24, 18);
  RenderCounts counts;
  const LayeredImage whole = renderer->RenderPass({0, 0, 24, 18}, 0, {8, 12}, &counts).pixels;
  const Rect tile = {5, 3, 17, 16};
  const LayeredImage part = renderer->RenderPass(tile, 0, {8, 12}, &counts).pixels;
  ExpectSameBits(part, Cut(whole, tile));
  const auto again = MakeRenderer(testing::SmallRoom(), 24, 18);
  ExpectSameBits(again->RenderPass(tile, 0, {8, 12}, &counts).pixels, part);
}

TEST(Renderer, GeometryOfAPlaneThatFacesTheCamera) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-1, -1, -3}, {2, 0, 0}, {0, 2, 0}, 0));
  scene.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 1.2f)};
  const LayeredImage geometry = MakeRenderer(scene, 17, 17)->RenderGeometry({0, 0, 17, 17}, 0).pixels;
  EXPECT_NEAR(geometry.Get(layers::kPlanarDepth).At(8, 8), 3, 1e-4);
  EXPECT_NEAR(geometry.Get(layers::kDistance).At(8, 8), 3, 1e-2);
  EXPECT_NEAR(geometry.Get(layers::kNormalZ).At(8, 8), 1, 1e-5);
  EXPECT_EQ(geometry.Get(layers::kObjectId).At(8, 8), 1);
  EXPECT_EQ(geometry.Get(layers::kMask).At(8, 8), 1);
  EXPECT_EQ(geometry.Get(layers::kAlpha).At(0, 0), 0);
  EXPECT_EQ(geometry.Get(layers::kDistance).At(0, 0), 0);
}

TEST(Renderer, MirrorsHaveNoDiffuseSurface) {
  scene::Material mirror;
  mirror.base.roughness = 0;
  const LayeredImage geometry =
      MakeRenderer(testing::Furnace(mirror), 9, 9)->RenderGeometry({4, 4, 5, 5}, 0).pixels;
  EXPECT_EQ(geometry.Get(layers::kMask).At(0, 0), 0);
  EXPECT_EQ(geometry.Get(layers::kAlpha).At(0, 0), 1);
}

TEST(Renderer, NamesWhatIsMissing) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-1, -1, -3}, {2, 0, 0}, {0, 2, 0}, 0));
  const auto renderer = MakeRenderer(scene, 8, 8);
  ASSERT_EQ(renderer->warnings().size(), 1u);
  EXPECT_THAT(renderer->warnings()[0], HasSubstr("no light"));
  RenderSettings settings;
  settings.width = settings.height = 8;
  settings.camera = "nobody";
  const auto missing = Renderer::Create(std::make_shared<scene::Scene>(scene), settings);
  EXPECT_EQ(missing.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(missing.status().message(), HasSubstr("nobody"));
}

TEST(Renderer, APartOfAFrameHasTheBitsOfItsPixels) {
  for (const PixelFilter& filter : {PixelFilter(), PixelFilter(PixelFilter::Kind::kGaussian, 2)}) {
    RenderSettings settings = SettingsOf(24, 18);
    settings.pixel_filter = filter;
    const LayeredImage whole =
        RenderAll(*MakeRenderer(testing::Furnace(testing::Lambert({1, 1, 1})), settings), 24, 18, 4);
    settings.width = 9;
    settings.height = 7;
    settings.frame = {24, 18, 11, 5};
    const LayeredImage part =
        RenderAll(*MakeRenderer(testing::Furnace(testing::Lambert({1, 1, 1})), settings), 9, 7, 4);
    ExpectSameBits(part, Cut(whole, {11, 5, 20, 12}));
  }
}

/// Clear glass that does not bend light, and takes half of the red on each metre.
scene::Material RedAbsorber() {
  scene::Material material;
  material.ior = 1;
  material.base.roughness = 0;
  material.base.metallic = 0;
  material.transmission.factor = 1;
  material.volume = {.is_solid = true, .attenuation_color = {0.5f, 1, 1}, .attenuation_distance = 1};
  return material;
}

TEST(Renderer, ACameraInsideASolidIsReachedThroughIt) {
  scene::Scene room;
  room.materials = {RedAbsorber(), testing::Emitter({2, 2, 2}), testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&room, testing::SphereMesh(1, 24, 0));
  testing::PlaceBoxInside(&room, 3, {1, 1, 1, 1, 1, 1});
  room.cameras = {testing::LookAt({0, 0, 0}, {0, 0.2f, -1}, 0.5f)};
  const auto inside = RenderAll(*MakeRenderer(room, SettingsOf(4, 4)), 4, 4, 4);
  EXPECT_NEAR(MeanOf(inside, layers::kNoisy, 0), 1, 0.01);
  EXPECT_NEAR(MeanOf(inside, layers::kNoisy, 1), 2, 0.01);
  // A sheet behind the camera's back is no solid, however its sides lie.
  scene::Scene sheet = room;
  sheet.meshes[0] = testing::QuadMesh({-1, -1, -1}, {0, 2, 0}, {2, 0, 0}, 0);
  const auto open = RenderAll(*MakeRenderer(sheet, SettingsOf(4, 4)), 4, 4, 4);
  EXPECT_NEAR(MeanOf(open, layers::kNoisy, 0), 2, 0.01);
}

}  // namespace
}  // namespace lumifold::render
