// Closed diffuse scenes with any number of bounces, whose radiance is known by other methods.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/scene/vec.h"

namespace lumifold::render {
namespace {

using scene::Scene;
using scene::Vec3;

constexpr int kManyBounces = 100;  // later bounces contribute less than any tolerance here

scene::Material Wall(float albedo, float emission) {
  scene::Material material = testing::Lambert({albedo, albedo, albedo});
  material.emission.radiance = {emission, emission, emission};
  return material;
}

/// Mean radiance in a narrow view from `from` towards `to`.
double RadianceSeen(const Scene& room, Vec3 from, Vec3 to, int max_bounces, uint32_t spp) {
  Scene scene = room;
  scene.cameras = {testing::LookAt(from, to, 0.02f)};
  const LayeredImage sums = RenderAll(*MakeRenderer(scene, SettingsOf(8, 8, max_bounces)), 8, 8, spp);
  return MeanOf(sums, layers::kNoisy);
}

Scene GlowingBox(float albedo, float emission) {
  Scene scene;
  scene.materials = {Wall(albedo, emission)};
  testing::PlaceBoxInside(&scene, 1, {0, 0, 0, 0, 0, 0});
  return scene;
}

TEST(Radiosity, EachBounceInAnEmissiveBoxAddsAPowerOfTheAlbedo) {
  constexpr float kAlbedo = 0.6f;
  double expected =
      1 + kAlbedo;  // emission of the first surface, and emission of its neighbours that it reflects
  for (int max_bounces = 0; max_bounces < 4; ++max_bounces) {
    const double seen = RadianceSeen(GlowingBox(kAlbedo, 1), {0.3f, 0, 0}, {0, -1, 0.2f}, max_bounces, 512);
    EXPECT_NEAR(seen / expected, 1, 3e-3) << max_bounces;
    expected += std::pow(kAlbedo, max_bounces + 2);
  }
}

TEST(Radiosity, AnEmissiveBoxMatchesTheGeometricSeries) {
  const double seen = RadianceSeen(GlowingBox(0.75f, 0.5f), {0.3f, 0, 0}, {0, -1, 0.2f}, kManyBounces, 512);
  EXPECT_NEAR(seen / (0.5 / (1 - 0.75)), 1, 5e-3);
}

TEST(Radiosity, AHollowSphereHasUniformIrradiance) {
  // The form factor between any two points of a sphere is the same, so the irradiance is uniform: pi times
  // the mean radiance, which is the mean emission over one minus the mean albedo.
  Scene scene;
  scene.materials = {Wall(0.2f, 2), Wall(0.8f, 0)};
  scene::Mesh upper = testing::SphereMesh(1, 24, 0);
  for (size_t i = 0; i < upper.triangles.size(); i += 3)
    std::swap(upper.triangles[i], upper.triangles[i + 1]);
  for (Vec3& normal : upper.normals) normal = -normal;
  scene::Mesh lower = upper;
  lower.material = 1;
  const size_t half = upper.triangles.size() / 2;  // rows run from the upper pole to the lower one
  lower.triangles.erase(lower.triangles.begin(), lower.triangles.begin() + static_cast<std::ptrdiff_t>(half));
  upper.triangles.resize(half);
  testing::Place(&scene, upper);
  testing::Place(&scene, lower);
  const double around = 0.5 * 2 / (1 - 0.5 * (0.2 + 0.8));
  EXPECT_NEAR(RadianceSeen(scene, {0, 0, 0}, {0.1f, -1, 0}, kManyBounces, 128) / (0.8 * around), 1, 1e-2);
  EXPECT_NEAR(RadianceSeen(scene, {0, 0, 0}, {0.9f, -0.5f, 0}, kManyBounces, 128) / (0.8 * around), 1, 1e-2);
  EXPECT_NEAR(RadianceSeen(scene, {0, 0, 0}, {0.1f, 1, 0}, kManyBounces, 128) / (2 + 0.2 * around), 1, 1e-2);
}

/// A face of the box [-1, 1]^3 in kPatches x kPatches patches.
constexpr int kPatches = 15;  // odd: the centre of a face is the centre of a patch
constexpr int kFaces = 6;
constexpr int kAllPatches = kFaces * kPatches * kPatches;

struct Patch {
  std::array<Vec3, 4> corners;  // counter-clockwise seen from inside
  Vec3 middle;
  Vec3 normal;
};

/// The faces' origins and edges, in the order of testing::PlaceBoxInside().
constexpr Vec3 kFaceOrigins[kFaces] = {{-1, -1, -1}, {-1, 1, -1},  {-1, -1, -1},
                                       {-1, -1, 1},  {-1, -1, -1}, {1, -1, -1}};
constexpr Vec3 kFaceEdges[kFaces][2] = {{{0, 0, 2}, {2, 0, 0}}, {{2, 0, 0}, {0, 0, 2}},
                                        {{2, 0, 0}, {0, 2, 0}}, {{0, 2, 0}, {2, 0, 0}},
                                        {{0, 2, 0}, {0, 0, 2}}, {{0, 0, 2}, {0, 2, 0}}};

std::vector<Patch> BoxPatches() {
  std::vector<Patch> patches;
  for (int face = 0; face < kFaces; ++face) {
    const Vec3 a = kFaceEdges[face][0] * (1.0f / kPatches);
    const Vec3 b = kFaceEdges[face][1] * (1.0f / kPatches);
    for (int i = 0; i < kPatches * kPatches; ++i) {
      const Vec3 origin =
          kFaceOrigins[face] + a * static_cast<float>(i % kPatches) + b * static_cast<float>(i / kPatches);
      patches.push_back({{origin, origin + a, origin + a + b, origin + b},
                         origin + (a + b) * 0.5f,
                         Normalize(Cross(a, b))});
    }
  }
  return patches;
}

/// The form factor from a point to a polygon entirely above its horizon. Source: Lambert 1760, the sum over
/// edges of the angle they span times the cosine of their plane's tilt.
double FormFactor(const Patch& from, const Patch& to) {
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    const Vec3 a = Normalize(to.corners[i] - from.middle);
    const Vec3 b = Normalize(to.corners[(i + 1) % 4] - from.middle);
    const Vec3 across = Cross(a, b);
    const float length = Length(across);
    if (length == 0) continue;
    sum -= std::atan2(length, Dot(a, b)) * static_cast<double>(Dot(across, from.normal) / length);
  }
  return sum / (2 * M_PI);
}

/// Radiance of each patch, by iteration of radiance = emission + albedo * sum of form factor times radiance.
std::vector<double> SolveRadiosity(const std::array<scene::Material, kFaces>& walls) {
  const std::vector<Patch> patches = BoxPatches();
  constexpr int kFacePatches = kPatches * kPatches;
  std::vector<double> factors(size_t{kAllPatches} * kAllPatches);
  for (int i = 0; i < kAllPatches; ++i) {
    for (int j = 0; j < kAllPatches; ++j) {
      if (i / kFacePatches != j / kFacePatches)
        factors[size_t{kAllPatches} * i + j] = FormFactor(patches[i], patches[j]);
    }
  }
  std::vector<double> radiance(kAllPatches, 0);
  for (int iteration = 0; iteration < 60; ++iteration) {
    for (int i = 0; i < kAllPatches; ++i) {
      const scene::Material& wall = walls[i / kFacePatches];
      double arriving = 0;
      for (int j = 0; j < kAllPatches; ++j) arriving += factors[size_t{kAllPatches} * i + j] * radiance[j];
      radiance[i] =
          static_cast<double>(wall.emission.radiance.x) + static_cast<double>(wall.base.color.x) * arriving;
    }
  }
  return radiance;
}

TEST(Radiosity, AClosedBoxOfDifferentWallsMatchesTheRadiositySystem) {
  const std::array<scene::Material, kFaces> walls = {Wall(0.7f, 0), Wall(0.3f, 1),    Wall(0.8f, 0),
                                                     Wall(0.5f, 0), Wall(0.2f, 0.2f), Wall(0.6f, 0)};
  const std::vector<double> solution = SolveRadiosity(walls);
  Scene scene;
  scene.materials.assign(walls.begin(), walls.end());
  testing::PlaceBoxInside(&scene, 1, {0, 1, 2, 3, 4, 5});
  for (int face = 0; face < kFaces; ++face) {
    const Vec3 middle = kFaceOrigins[face] + (kFaceEdges[face][0] + kFaceEdges[face][1]) * 0.5f;
    const double expected =
        solution[static_cast<size_t>(face * kPatches * kPatches + kPatches * kPatches / 2)];
    EXPECT_NEAR(RadianceSeen(scene, {0.1f, 0.2f, 0.15f}, middle, kManyBounces, 1024) / expected, 1, 8e-3)
        << face;
  }
  // In a corner of the floor, where the adjacent walls have larger form factors.
  const double corner = solution[kPatches + 1];
  const float place = -1 + 1.5f * 2 / kPatches;
  EXPECT_NEAR(RadianceSeen(scene, {0, 0, 0}, {place, -1, place}, kManyBounces, 1024) / corner, 1, 1e-2);
}

constexpr float kLampHeight = 1;

/// A 1 x 1 lamp centred on the vertical axis through (x, 0, 0), with radiance 1 on both sides.
void PlaceLamp(float x, Scene* scene, Patch* lamp) {
  lamp->corners = {Vec3{x - 0.5f, kLampHeight, -0.5f},
                   {x + 0.5f, kLampHeight, -0.5f},
                   {x + 0.5f, kLampHeight, 0.5f},
                   {x - 0.5f, kLampHeight, 0.5f}};
  scene->materials = {Wall(0.8f, 0), testing::Emitter({1, 1, 1})};
  scene->materials[1].double_sided = true;
  testing::Place(scene, testing::QuadMesh(lamp->corners[0], {1, 0, 0}, {0, 0, 1}, 1));
}

TEST(Radiosity, AWallBesideALampMatchesItsFormFactor) {
  // Up to grazing incidence: the wall is 0.4 from the lamp's edge.
  Scene scene;
  Patch lamp;
  PlaceLamp(0, &scene, &lamp);
  testing::Place(&scene, testing::QuadMesh({0.9f, -2, -2}, {0, 0, 4}, {0, 4, 0}, 0));
  for (const float height : {-1.0f, 0.0f, 0.5f, 0.9f, 0.96f}) {
    Patch wall;
    wall.middle = {0.9f, height, 0.1f};
    wall.normal = {-1, 0, 0};
    const double expected = 0.8 * FormFactor(wall, lamp);
    EXPECT_NEAR(RadianceSeen(scene, {0.6f, height - 0.1f, 0.1f}, wall.middle, 0, 8192) / expected, 1, 5e-3)
        << height;
  }
}

TEST(Radiosity, ALampCloseUnderTheCeilingDoesNotShadowItself) {
  // Light leaves the lamp at up to 88 degrees to its normal. Far from the origin, ray origins have larger
  // offsets.
  constexpr float kCeiling = kLampHeight + 0.02f;
  for (const float x : {0.0f, 30.0f}) {
    Scene scene;
    Patch lamp;
    PlaceLamp(x, &scene, &lamp);
    std::swap(lamp.corners[1], lamp.corners[3]);  // its upper side
    testing::Place(&scene, testing::QuadMesh({x - 2, kCeiling, -2}, {4, 0, 0}, {0, 0, 4}, 0));
    Patch ceiling;
    ceiling.middle = {x + 0.7f, kCeiling, 0.1f};
    ceiling.normal = {0, -1, 0};
    const double expected = 0.8 * std::abs(FormFactor(ceiling, lamp));
    EXPECT_NEAR(RadianceSeen(scene, {x + 0.8f, 0.5f, 0.1f}, ceiling.middle, 0, 4096) / expected, 1, 2e-2)
        << x;
  }
}

}  // namespace
}  // namespace lumifold::render
