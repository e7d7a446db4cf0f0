#include "worker/render/lights/lights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/lights/alias_table.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using scene::PunctualLight;
using scene::Scene;
using scene::Vec3;

/// Irradiance over pi, in W/m^2, of a small patch of floor at (x, 0, 0), lit by the lights of `scene`.
double PatchLight(Scene scene, float x, uint32_t spp = 16) {
  scene.materials.insert(scene.materials.begin(), testing::Lambert({0.5f, 0.5f, 0.5f}));
  for (scene::Mesh& mesh : scene.meshes) ++mesh.material;
  testing::Place(&scene, testing::QuadMesh({-5, 0, -5}, {0, 0, 10}, {10, 0, 0}, 0));
  scene.cameras = {testing::LookAt({x, 0.5f, 0}, {x, 0, 0}, 0.002f)};
  return MeanOf(RenderAll(*MakeRenderer(scene, SettingsOf(8, 8, 0)), 8, 8, spp), layers::kDirect);
}

/// A light at a height of 2 above the origin that points down.
PunctualLight Hanging(PunctualLight::Kind kind, float intensity) {
  PunctualLight light;
  light.kind = kind;
  light.intensity = intensity * kLumensPerWatt;
  light.world_from_light = {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}, {0, 2, 0}};
  return light;
}

TEST(AliasTable, PicksInProportionToWeights) {
  const std::vector<double> weights = {0, 3, 1, 0.5, 0, 7, 2.5};
  const AliasTable table(weights);
  constexpr int kPicks = 7000;
  std::vector<int> picked(weights.size());
  for (int i = 0; i < kPicks; ++i) ++picked[table.Pick((static_cast<float>(i) + 0.5f) / kPicks)];
  for (uint32_t i = 0; i < weights.size(); ++i) {
    EXPECT_NEAR(table.Probability(i), weights[i] / 14, 1e-6);
    EXPECT_NEAR(picked[i], weights[i] / 14 * kPicks, 4) << i;
  }
  EXPECT_TRUE(AliasTable({0, 0}).IsEmpty());
}

TEST(Lights, PointFollowsTheInverseSquareLaw) {
  Scene scene;
  scene.lights = {Hanging(PunctualLight::Kind::kPoint, 10)};
  for (const double x : {0.0, 1.0, 3.0}) {
    const double d2 = 4 + x * x;
    const double irradiance = 10 / d2 * 2 / std::sqrt(d2);
    EXPECT_NEAR(PatchLight(scene, static_cast<float>(x)) * M_PI, irradiance, irradiance * 2e-3) << x;
  }
}

TEST(Lights, RangeEndsSmoothly) {
  Scene scene;
  scene.lights = {Hanging(PunctualLight::Kind::kPoint, 10)};
  scene.lights[0].range = 4;
  EXPECT_NEAR(PatchLight(scene, 0) * M_PI, 10.0 / 4 * (1 - std::pow(0.5, 4)), 5e-3);
  scene.lights[0].range = 1.9f;
  EXPECT_EQ(PatchLight(scene, 0), 0);
}

TEST(Lights, SpotHasAConeWithASoftEdge) {
  Scene scene;
  scene.lights = {Hanging(PunctualLight::Kind::kSpot, 10)};
  scene.lights[0].inner_cone_angle = 0.3f;
  scene.lights[0].outer_cone_angle = 0.6f;
  const auto expected = [](double angle) {
    const double cosine = std::cos(angle);
    const double cone = std::clamp((cosine - std::cos(0.6)) / (std::cos(0.3) - std::cos(0.6)), 0.0, 1.0);
    return 10 / 4.0 * cosine * cosine * cosine * cone * cone;
  };
  for (const double angle : {0.0, 0.25, 0.4, 0.5}) {
    EXPECT_NEAR(PatchLight(scene, static_cast<float>(2 * std::tan(angle))) * M_PI, expected(angle), 5e-3)
        << angle;
  }
  EXPECT_EQ(PatchLight(scene, static_cast<float>(2 * std::tan(0.62))), 0);
}

TEST(Lights, DirectionalLightIsUniform) {
  Scene scene;
  scene.lights = {Hanging(PunctualLight::Kind::kDirectional, 3)};
  // Tilted by 60 degrees: the floor receives half the irradiance.
  const float s = std::sqrt(0.75f);
  scene.lights[0].world_from_light.z = {s, 0.5f, 0};
  scene.lights[0].world_from_light.y = {-0.5f, s, 0};
  scene.lights[0].world_from_light.x = {0, 0, 1};
  for (const float x : {0.0f, 2.5f}) EXPECT_NEAR(PatchLight(scene, x) * M_PI, 1.5, 2e-3) << x;
}

TEST(Lights, PunctualLightsCastShadows) {
  for (const PunctualLight::Kind kind :
       {PunctualLight::Kind::kPoint, PunctualLight::Kind::kSpot, PunctualLight::Kind::kDirectional}) {
    Scene scene;
    scene.lights = {Hanging(kind, 1)};
    EXPECT_GT(PatchLight(scene, 0), 0);
    scene.materials = {testing::Lambert({0, 0, 0})};
    testing::Place(&scene, testing::QuadMesh({-1, 1.5f, -1}, {0, 0, 2}, {2, 0, 0}, 0));
    EXPECT_EQ(PatchLight(scene, 0), 0);
  }
}

/// A ceiling of n x n lamps of different power, each two double-sided triangles or a point light.
Scene Lamps(int n) {
  Scene scene;
  for (int i = 0; i < n * n; ++i) {
    const float x = (static_cast<float>(i % n) + 0.3f) / static_cast<float>(n) * 6 - 3;
    const float z = (static_cast<float>(i / n) + 0.5f) / static_cast<float>(n) * 6 - 3;
    const float strength = 1.0f + static_cast<float>(i % 7);
    if (i % 3 == 0) {
      PunctualLight light =
          Hanging(i % 2 == 0 ? PunctualLight::Kind::kPoint : PunctualLight::Kind::kSpot, strength);
      light.world_from_light.origin = {x, 1, z};
      scene.lights.push_back(light);
    } else {
      scene.materials.push_back(testing::Emitter({strength * 10, strength * 10, strength * 10}));
      scene.materials.back().double_sided = i % 2 == 0;
      testing::Place(&scene, testing::QuadMesh({x, 1, z}, {0.2f, 0, 0}, {0, 0.1f, 0.15f},
                                               static_cast<int>(scene.materials.size()) - 1));
    }
  }
  return scene;
}

TEST(Lights, TreeAgreesWithTheSumOverAllLights) {
  const Scene all = Lamps(8);  // more than a hundred emitters, enough for a light tree
  double sum = 0;
  for (size_t i = 0; i < all.lights.size(); ++i) {
    Scene one;
    one.lights = {all.lights[i]};
    sum += PatchLight(one, 0.7f);
  }
  for (size_t i = 0; i < all.meshes.size(); ++i) {
    Scene one;
    one.materials = all.materials;
    testing::Place(&one, all.meshes[i]);
    sum += PatchLight(one, 0.7f, 64);
  }
  EXPECT_NEAR(PatchLight(all, 0.7f, 2048) / sum, 1, 0.01);
}

TEST(Lights, AllKindsTogetherGiveTheSumOfEach) {
  LayeredImage picture(16, 8);
  for (const FloatView& channel : picture.AddColor("")) {
    for (int y = 0; y < 8; ++y) {
      for (int x = 0; x < 16; ++x) channel.At(x, y) = 0.1f * static_cast<float>(x);
    }
  }
  const auto picture_light = *Environment::Create(picture, 10, 1);
  scene::Scene room;
  scene::Material glossy = testing::Lambert({0.5f, 0.6f, 0.7f});
  glossy.specular.factor = 1;
  glossy.base.roughness = 0.5f;
  room.materials = {glossy, testing::Emitter({4, 4, 4})};
  testing::Place(&room, testing::SphereMesh(1, 12, 0));
  room.cameras = {testing::LookAt({0, 1, 4}, {0, 0, 0}, 0.6f)};
  const auto brightness = [&](bool lamp, bool point, bool sun, bool environment) {
    Scene scene = room;
    if (lamp) testing::Place(&scene, testing::QuadMesh({-1, 3, -1}, {2, 0, 0}, {0, 0, 2}, 1));
    if (point) scene.lights.push_back(Hanging(PunctualLight::Kind::kPoint, 2));
    if (sun) {  // from the side, where the lamp does not occlude it
      scene.lights.push_back(Hanging(PunctualLight::Kind::kDirectional, 1));
      scene.lights.back().world_from_light = {{0, 0, -1}, {0, 1, 0}, {1, 0, 0}, {0, 0, 0}};
    }
    RenderSettings settings = SettingsOf(12, 12, 0);
    if (environment) settings.environment = picture_light;
    return MeanOf(RenderAll(*MakeRenderer(scene, settings), 12, 12, 512), layers::kNoisy);
  };
  const double lamp = brightness(true, false, false, false);
  const double rest = brightness(false, true, false, false) + brightness(false, false, true, false);
  // The lamp occludes a part of the environment; without emission it shows what the environment contributes.
  room.materials[1].emission.radiance = {1e-12f, 1e-12f, 1e-12f};
  const double environment_behind_lamp = brightness(true, false, false, true);
  room.materials[1].emission.radiance = {4, 4, 4};
  const double sum = lamp + rest + environment_behind_lamp;
  EXPECT_NEAR(brightness(true, true, true, true) / sum, 1, 5e-3);
}

TEST(Lights, TheDensityOfASampleHasTheProbabilityOfItsLight) {
  Scene scene;
  scene.materials = {testing::Emitter({4, 4, 4})};
  testing::Place(&scene, testing::QuadMesh({-1, 3, -1}, {2, 0, 0}, {0, 0, 2}, 0));
  scene.lights = {Hanging(PunctualLight::Kind::kPoint, 2), Hanging(PunctualLight::Kind::kDirectional, 1)};
  LayeredImage picture(4, 2);
  for (const FloatView& channel : picture.AddColor("")) {
    ForEachPixel(4, 2, [&](int x, int y) { channel.At(x, y) = 0.1f + static_cast<float>(x + y); });
  }
  const auto environment = *Environment::Create(picture, 10, 1);
  const TextureSampler textures(scene);
  const LightSet lights(scene, textures, environment);
  const LightReceiver from = {{0, 0, 0}, {0, 1, 0}};
  constexpr int kPicks = 4000;
  std::array<int, 4> picked = {};  // environment, sun, lamp, point
  std::array<float, 4> probability = {};
  for (int i = 0; i < kPicks; ++i) {
    const LightSample sample = lights.Sample(from, (static_cast<float>(i) + 0.5f) / kPicks, {0.3f, 0.7f});
    const bool is_near = std::isfinite(sample.distance);
    const size_t kind = (is_near ? 2 : 0) + (sample.is_delta ? 1 : 0);
    ++picked[kind];
    float density = 1;  // of the light's own samples
    if (kind == 0) {
      density = environment->Density(sample.direction);
      EXPECT_NEAR(sample.pdf / lights.EnvironmentDensity(sample.direction), 1, 1e-4f);
    }
    if (kind == 2) {
      density = sample.distance * sample.distance / (4 * sample.direction.y);
      EXPECT_NEAR(sample.pdf / lights.DensityOfHit(from, 0, 0, sample.distance, sample.direction.y), 1,
                  1e-4f);
    }
    probability[kind] = sample.pdf / density;
  }
  for (size_t kind = 0; kind < 4; ++kind)
    EXPECT_NEAR(probability[kind], static_cast<float>(picked[kind]) / kPicks, 1e-3f) << kind;
}

/// The densities with which a triangle of `scene`'s first mesh is hit below the origin.
std::array<float, 2> DensitiesOfTriangles(const Scene& scene) {
  const TextureSampler textures(scene);
  const LightSet lights(scene, textures, nullptr);
  const LightReceiver from = {{0, 0, 0}, {0, 1, 0}};
  return {lights.DensityOfHit(from, 0, 0, 1, 1), lights.DensityOfHit(from, 0, 1, 1, 1)};
}

TEST(Lights, TwoTrianglesOfAParallelogramAreOneLight) {
  Scene scene;
  scene.materials = {testing::Emitter({4, 4, 4})};
  testing::Place(&scene, testing::QuadMesh({-3, 2, -1}, {4, 0, 0}, {0, 0, 2}, 0));
  std::vector<uint32_t>& triangles = scene.meshes[0].triangles;
  for (int turn = 0; turn < 3; ++turn) {
    std::rotate(triangles.begin(), triangles.begin() + 1, triangles.begin() + 3);
    EXPECT_THAT(DensitiesOfTriangles(scene), ::testing::Each(::testing::FloatEq(1.0f / 8))) << turn;
    const TextureSampler textures(scene);
    const LightSet lights(scene, textures, nullptr);
    std::array<int, 4> quarters = {};
    for (int i = 0; i < 256; ++i) {
      const Vec2 u = {(static_cast<float>(i % 16) + 0.5f) / 16, (static_cast<float>(i / 16) + 0.5f) / 16};
      const LightSample sample = lights.Sample({{0, 0, 0}, {0, 1, 0}}, 0.5f, u);
      const Vec3 point = sample.direction * sample.distance;
      EXPECT_NEAR(point.y, 2, 1e-5f);
      ++quarters[(point.x > -1 ? 1 : 0) + (point.z > 0 ? 2 : 0)];
    }
    EXPECT_THAT(quarters, ::testing::Each(64)) << turn;
  }
  scene.meshes[0].positions[3].y += 1;  // no parallelogram any more
  const std::array<float, 2> apart = DensitiesOfTriangles(scene);
  EXPECT_GT(std::abs(apart[0] - apart[1]), 1e-3f);
}

TEST(Lights, ATriangleIsTheSameWhicheverOfItsCornersIsFirst) {
  // Enough small lamps in the distance for a light tree, and a long one whose ends are far from each other.
  for (const bool has_tree : {false, true}) {
    std::vector<float> densities;
    for (uint32_t first = 0; first < 3; ++first) {
      Scene scene;
      scene.materials = {testing::Emitter({1, 2, 3})};
      scene::Mesh lamp;
      lamp.material = 0;
      lamp.positions = {{0, 0, 0}, {0.2f, 0, 9}, {8, 0.1f, 0}};
      lamp.triangles = {first, (first + 1) % 3, (first + 2) % 3};
      testing::Place(&scene, lamp);
      for (int i = 0; i < (has_tree ? 40 : 3); ++i)
        testing::Place(&scene, testing::QuadMesh({-20, static_cast<float>(i), 0}, {1, 0, 0}, {0, 0, 1}, 0));
      const TextureSampler textures(scene);
      const LightSet lights(scene, textures, nullptr);
      for (const Vec3 from : {Vec3{0.1f, 1, 0.1f}, Vec3{0.2f, 1, 8.5f}, Vec3{7.5f, 1, 0.1f}, Vec3{2, -1, 2}})
        densities.push_back(lights.DensityOfHit({from, {0, 1, 0}}, 0, 0, 2, 0.5f));
    }
    for (size_t i = 0; i < 4; ++i) {
      EXPECT_NEAR(densities[4 + i] / densities[i], 1, 1e-3f) << i;
      EXPECT_NEAR(densities[8 + i] / densities[i], 1, 1e-3f) << i;
    }
  }
}

TEST(Lights, AllStrategiesConvergeToTheSamePicture) {
  Scene lamps = Lamps(10);
  lamps.lights.clear();
  Scene lit = testing::SmallRoom();
  lit.materials[4].base.roughness = 0.5f;
  struct Case {
    Scene scene;
    double tolerance;
  };
  lamps.materials.push_back(testing::Lambert({0.6f, 0.6f, 0.6f}));
  testing::Place(&lamps, testing::QuadMesh({-5, 0, -5}, {0, 0, 10}, {10, 0, 0},
                                           static_cast<int>(lamps.materials.size()) - 1));
  lamps.cameras = {testing::LookAt({0, 0.9f, 2}, {0, 0, 0}, 0.8f)};
  for (const Case& c : {Case{lit, 0.02}, Case{lamps, 0.02}}) {
    double mean[3];
    for (const LightStrategy strategy :
         {LightStrategy::kCombined, LightStrategy::kLightSamples, LightStrategy::kBsdfHits}) {
      // Hits alone have a far higher variance.
      const uint32_t spp = strategy == LightStrategy::kBsdfHits ? 8192 : 512;
      const LayeredImage image =
          RenderAll(*MakeRenderer(c.scene, SettingsOf(16, 12, 2), strategy), 16, 12, spp);
      mean[static_cast<int>(strategy)] = MeanOf(image, layers::kNoisy);
    }
    EXPECT_NEAR(mean[1] / mean[0], 1, c.tolerance);
    EXPECT_NEAR(mean[2] / mean[0], 1, c.tolerance);
  }
}

TEST(Lights, IsIndependentOfTilesWithATreeALensAndAnEnvironment) {
  Scene scene = Lamps(10);
  scene.materials.push_back(testing::Lambert({0.6f, 0.6f, 0.6f}));
  testing::Place(&scene, testing::QuadMesh({-5, 0, -5}, {0, 0, 10}, {10, 0, 0},
                                           static_cast<int>(scene.materials.size()) - 1));
  scene.cameras = {testing::LookAt({0, 0.9f, 2}, {0, 0, 0}, 1.2f)};
  LayeredImage picture(4, 2);
  picture.AddColor("")[2].At(1, 0) = 3;
  RenderSettings settings = SettingsOf(20, 14);
  settings.environment = *Environment::Create(picture, 10, 1);
  settings.lens = {2, 1};
  RenderCounts counts;
  const LayeredImage whole =
      MakeRenderer(scene, settings)->RenderPass({0, 0, 20, 14}, 0, {0, 4}, &counts).pixels;
  const LayeredImage part =
      MakeRenderer(scene, settings)->RenderPass({7, 3, 15, 11}, 0, {0, 4}, &counts).pixels;
  for (const LayeredImage::Channel& channel : part.channels()) {
    for (int y = 0; y < 8; ++y) {
      for (int x = 0; x < 8; ++x)
        ASSERT_EQ(channel.plane.At(x, y), whole.Get(channel.name).At(x + 7, y + 3)) << channel.name;
    }
  }
}

}  // namespace
}  // namespace lumifold::render
