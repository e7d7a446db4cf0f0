#include "worker/scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace lumifold::scene {
namespace {

/// A scene of one unit right triangle, placed as given.
Scene TriangleAt(const Affine& world_from_object) {
  Scene scene;
  Mesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {0, 1, 2};
  scene.meshes.push_back(mesh);
  scene.instances.push_back({0, world_from_object, ""});
  return scene;
}

TEST(Scene, BoundsContainAllInstances) {
  Scene scene = TriangleAt({{2, 0, 0}, {0, 2, 0}, {0, 0, 2}, {10, 0, 0}});
  scene.instances.push_back({0, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -5}}, ""});
  const Bounds bounds = WorldBounds(scene);
  EXPECT_EQ(bounds.min, (Vec3{0, 0, -5}));
  EXPECT_EQ(bounds.max, (Vec3{12, 2, 0}));
}

TEST(Scene, BoundsReachEachVertexOnEachSide) {
  const Affine turned = {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}, {0, 0, 0}};  // x to y to z to x
  for (size_t vertex = 0; vertex < 3; ++vertex) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const float reach : {-7.0f, 7.0f}) {
        Vec3 far;
        (axis == 0 ? far.x : axis == 1 ? far.y : far.z) = reach;
        Scene scene = TriangleAt({});
        scene.meshes[0].positions[vertex] = far;
        EXPECT_EQ(WorldBounds(scene).min[axis], std::min(reach, 0.0f)) << vertex << axis;
        EXPECT_EQ(std::max(WorldBounds(scene).max[axis], 1.0f), std::max(reach, 1.0f)) << vertex << axis;
        scene.instances[0].world_from_object = turned;
        EXPECT_EQ(WorldBounds(scene).min[(axis + 1) % 3], std::min(reach, 0.0f)) << vertex << axis;
        EXPECT_EQ(std::max(WorldBounds(scene).max[(axis + 1) % 3], 1.0f), std::max(reach, 1.0f)) << axis;
      }
    }
  }
}

TEST(Scene, BoundsOfNothingAreEmpty) { EXPECT_TRUE(WorldBounds(Scene{}).IsEmpty()); }

TEST(Scene, FindsCamerasByName) {
  Scene scene;
  scene.cameras.resize(2);
  scene.cameras[0].name = "front";
  scene.cameras[1].name = "side";
  EXPECT_EQ(FindCamera(scene, "", 1)->name, "front");
  EXPECT_EQ(FindCamera(scene, "side", 1)->name, "side");
  EXPECT_EQ(FindCamera(scene, "1", 1)->name, "side");
  EXPECT_EQ(FindCamera(scene, "back", 1).status().message(),
            "the scene has no camera called 'back'; there are: 0 'front', 1 'side'");
  EXPECT_EQ(FindCamera(Scene{}, "0", 1).status().message(),
            "the scene has no camera called '0'; it has no camera");
}

TEST(Scene, FittedCameraSeesEverythingAndFillsTheFrame) {
  const Scene scene = TriangleAt({{30, 0, 0}, {0, 20, 0}, {0, 0, 1}, {100, -50, 7}});
  for (const float aspect : {0.5f, 1.0f, 2.4f}) {
    const Camera camera = *FindCamera(scene, "", aspect);
    const Affine& a = camera.world_from_camera;
    EXPECT_NEAR(a.Determinant(), 1, 1e-5);
    EXPECT_GT(a.z.z, 0.75f) << "from the front, which in glTF is +z";
    EXPECT_GT(a.z.x, 0.4f) << "and half from the right";
    EXPECT_GT(a.z.y, 0) << "and a little above";
    float widest = 0;
    for (const Vec3& p : scene.meshes[0].positions) {
      const Vec3 d = scene.instances[0].world_from_object.Point(p) - a.origin;
      const float depth = -Dot(d, a.z);
      ASSERT_GT(depth, 0);
      const float half_height = depth * std::tan(camera.yfov / 2);
      widest = std::max(
          {widest, std::fabs(Dot(d, a.y)) / half_height, std::fabs(Dot(d, a.x)) / (half_height * aspect)});
    }
    EXPECT_LT(widest, 1);
    EXPECT_GT(widest, 0.8f) << aspect;
  }
}

TEST(Scene, FittedCameraOfAnEmptySceneIsFinite) {
  const Camera camera = *FindCamera(Scene{}, "", 1);
  EXPECT_TRUE(std::isfinite(Length(camera.world_from_camera.origin)));
}

TEST(ShadowGround, LiesJustBelowTheScene) {
  Scene scene;
  AddShadowGround(&scene);
  EXPECT_TRUE(scene.catchers.empty());
  scene.meshes.emplace_back().positions = {{-1, 0.5f, 0}, {1, 0.5f, 0}, {0, 2.5f, 0}};
  scene.instances.push_back({0, {}, ""});
  scene.instances[0].world_from_object.origin = {10, 1, 3};
  const Bounds before = WorldBounds(scene);
  AddShadowGround(&scene);
  ASSERT_EQ(scene.catchers.size(), 1u);
  const Mesh& ground = scene.meshes[static_cast<size_t>(scene.catchers[0].mesh)];
  for (const Vec3 corner : ground.positions) {
    EXPECT_LT(corner.y, 1.5f);
    EXPECT_NEAR(corner.y, 1.5f, 1e-4f);
    EXPECT_GT(std::abs(corner.x - 10), 20);
  }
  EXPECT_EQ(WorldBounds(scene).min, before.min) << "the camera is not moved";
  // Two triangles that face up and fill the square.
  ASSERT_EQ(ground.triangles.size(), 6u);
  float area = 0;
  for (size_t i = 0; i < 6; i += 3) {
    const auto corner = [&](size_t k) {
      return ground.positions[static_cast<size_t>(ground.triangles[i + k])];
    };
    const Vec3 normal = Cross(corner(1) - corner(0), corner(2) - corner(0));
    EXPECT_GT(normal.y, 0);
    area += 0.5f * normal.y;
  }
  const float edge = 40 * Length(before.max - before.min);
  EXPECT_NEAR(area, edge * edge, 1e-3f * edge * edge);
  Vec3 sum = {0, 0, 0};
  for (const Vec3 corner : ground.positions) sum = sum + corner;
  EXPECT_NEAR(0.25f * sum.x, 10, 1e-4f);
  EXPECT_NEAR(0.25f * sum.z, 3, 1e-4f);
}

}  // namespace
}  // namespace lumifold::scene
