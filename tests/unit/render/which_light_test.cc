// Noise of scenes in which most of the lights' power does not reach the surface.
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using scene::PunctualLight;
using scene::Scene;

constexpr int kPictureEdge = 16;
constexpr int kNoiseFrames = 8;

/// The squared error of diffuse light, of `samples` a pixel, over the square of the picture's mean.
double NoiseOf(const Scene& scene, uint32_t samples) {
  const auto renderer = MakeRenderer(scene, SettingsOf(kPictureEdge, kPictureEdge, /*max_bounces=*/2));
  std::vector<double> sum(kPictureEdge * kPictureEdge);
  std::vector<double> squares(kPictureEdge * kPictureEdge);
  for (int frame = 0; frame < kNoiseFrames; ++frame) {
    RenderCounts counts;
    const LayeredImage pass =
        renderer->RenderPass({0, 0, kPictureEdge, kPictureEdge}, frame, {0, samples}, &counts).pixels;
    for (int y = 0; y < kPictureEdge; ++y) {
      for (int x = 0; x < kPictureEdge; ++x) {
        double value = 0;
        for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) {
          value += static_cast<double>(pass.GetColor(layers::HalfA(layer))[1].At(x, y)) +
                   static_cast<double>(pass.GetColor(layers::HalfB(layer))[1].At(x, y));
        }
        sum[y * kPictureEdge + x] += value;
        squares[y * kPictureEdge + x] += value * value;
      }
    }
  }
  double variance = 0;
  double mean = 0;
  for (size_t i = 0; i < sum.size(); ++i) {
    mean += sum[i] / kNoiseFrames / static_cast<double>(sum.size());
    variance +=
        (squares[i] - sum[i] * sum[i] / kNoiseFrames) / (kNoiseFrames - 1) / static_cast<double>(sum.size());
  }
  return variance / (mean * mean);
}

/// The lamp of a room, below its ceiling.
void Hang(Scene* scene, float x, float z, float strength, float size) {
  scene->materials.push_back(testing::Emitter({strength, strength, strength}));
  testing::Place(scene, testing::QuadMesh({x - size / 2, 2.4f, z - size / 2}, {size, 0, 0}, {0, 0, size},
                                          static_cast<int>(scene->materials.size()) - 1));
}

/// `count` rooms in a row along the x axis, of 4 x 2.5 x 4 m, with walls between them. The camera is in the
/// first.
Scene Rooms(int count) {
  Scene scene;
  scene.materials = {testing::Lambert({0.6f, 0.6f, 0.6f})};
  const float end = 4 * static_cast<float>(count);
  testing::Place(&scene, testing::QuadMesh({0, 0, 0}, {0, 0, 4}, {end, 0, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({0, 2.5f, 0}, {end, 0, 0}, {0, 0, 4}, 0));
  testing::Place(&scene, testing::QuadMesh({0, 0, 0}, {end, 0, 0}, {0, 2.5f, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({0, 0, 4}, {0, 2.5f, 0}, {end, 0, 0}, 0));
  for (int wall = 0; wall <= count; ++wall)
    testing::Place(&scene,
                   testing::QuadMesh({4 * static_cast<float>(wall), 0, 0}, {0, 0, 4}, {0, 2.5f, 0}, 0));
  scene.cameras = {testing::LookAt({0.3f, 1.2f, 3.7f}, {2.5f, 0.9f, 0.5f}, 1.0f)};
  return scene;
}

TEST(WhichLight, TheLampOfTheNextRoomAddsLittleNoise) {
  Scene one = Rooms(2);
  Hang(&one, 2, 2, 10, 0.5f);
  Scene two = one;
  Hang(&two, 6, 2, 20, 0.5f);
  EXPECT_LT(NoiseOf(two, 16), 4 * NoiseOf(one, 16)) << "by power 10 times";
}

TEST(WhichLight, LampsOfOtherRoomsAddLittleNoiseWhereAPointSeesThreeOfTwoHundred) {
  constexpr int kRooms = 67;
  Scene three = Rooms(kRooms);
  Scene all = three;
  for (int room = 0; room < kRooms; ++room) {
    for (int lamp = 0; lamp < 3; ++lamp) {
      const auto hang = [&](Scene* scene) {
        Hang(scene, 4 * static_cast<float>(room) + 1 + static_cast<float>(lamp),
             1.5f + static_cast<float>(lamp % 2), 5 + 5 * static_cast<float>(lamp), 0.3f);
      };
      hang(&all);
      if (room == 0) hang(&three);
    }
  }
  EXPECT_LT(NoiseOf(all, 16), 4 * NoiseOf(three, 16)) << "by power 340 times";
}

/// A floor that a roof keeps from the sun; a spot beside the roof lights it.
TEST(WhichLight, TheUmbraOfASunIsSmoothInTheLightOfASpot) {
  Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f}), testing::Lambert({0, 0, 0})};
  testing::Place(&scene, testing::QuadMesh({-5, 0, -5}, {0, 0, 10}, {10, 0, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-2, 3, -2}, {4, 0, 0}, {0, 0, 4}, 1));
  PunctualLight light;
  light.world_from_light = {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}, {0, 2, 0}};
  light.kind = PunctualLight::Kind::kSpot;
  light.intensity = 100 * kLumensPerWatt;
  light.outer_cone_angle = 1.2f;
  scene.lights = {light};
  light.kind = PunctualLight::Kind::kDirectional;
  light.intensity = 0.7f * kLumensPerWatt;
  scene.lights.push_back(light);
  scene.cameras = {testing::LookAt({0, 1, 0}, {0, 0, 0}, 0.02f)};
  EXPECT_LT(NoiseOf(scene, 64), 0.002 * 0.002) << "by power an error of 1.7 %";
}

}  // namespace
}  // namespace lumifold::render
