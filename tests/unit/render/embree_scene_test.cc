#include "worker/render/tracing/embree_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <set>
#include <span>
#include <thread>
#include <vector>

#include "absl/synchronization/notification.h"
#include "filter/image/mix_bits.h"
#include "filter/image/parallel.h"
#include "tests/bench/embree_tap.h"
#include "tests/support/analytic_scenes.h"

namespace lumifold::render {
namespace {

TEST(EmbreeScene, DoesNotLimitOtherThreadPools) {
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "one core only";
  const auto embree = EmbreeScene::Create(scene::Scene{});
  ASSERT_TRUE(embree.ok()) << embree.status();
  // Each of two tasks waits until the other begins; with one thread both would time out.
  std::array<absl::Notification, 2> begun;
  std::atomic<int> notified = 0;
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(2);
  pool->Run(2, [&](int64_t i) {
    begun[static_cast<size_t>(i)].Notify();
    if (begun[static_cast<size_t>(1 - i)].WaitForNotificationWithTimeout(absl::Minutes(5))) ++notified;
  });
  EXPECT_EQ(notified, 2);
}

/// The small room with a half-transparent sheet and a sheet that alpha masking cuts out.
scene::Scene RoomWithSheets() {
  scene::Scene scene = testing::SmallRoom();
  for (const scene::AlphaMode mode : {scene::AlphaMode::kBlend, scene::AlphaMode::kMask}) {
    scene::Material sheet = testing::Lambert({0.5f, 0.5f, 0.5f});
    sheet.alpha_mode = mode;
    sheet.base.alpha = 0.5f;
    sheet.alpha_cutoff = 0.7f;
    scene.materials.push_back(sheet);
    const float z = mode == scene::AlphaMode::kBlend ? 0.5f : 0.6f;
    testing::Place(&scene, testing::QuadMesh({-0.5f, -0.5f, z}, {1, 0, 0}, {0, 1, 0},
                                             static_cast<int>(scene.materials.size()) - 1));
  }
  return scene;
}

/// Rays from one point in all directions, each with its random key.
std::vector<Ray> Bundle(int count) {
  std::vector<Ray> rays;
  for (int i = 0; i < count; ++i) {
    const uint64_t bits = MixBits(static_cast<uint64_t>(i));
    const auto part = [bits](int shift) {
      return static_cast<float>(bits >> shift & 0xffffu) * 0x1p-15f - 1;
    };
    Ray ray = {{.origin = {0.1f, 0.2f, 0.8f},
                .direction = Normalize(scene::Vec3{part(0), part(16), part(32) - 1.5f}),
                .max_distance = 1.2f}};
    ray.random_key = static_cast<uint64_t>(i);
    rays.push_back(ray);
  }
  return rays;
}

TEST(EmbreeScene, PacketsAndSingleRaysHaveEqualHits) {
  const scene::Scene scene = RoomWithSheets();
  const auto embree = EmbreeScene::Create(scene);
  ASSERT_TRUE(embree.ok()) << embree.status();
  const std::vector<Ray> rays = Bundle(400);
  int hit_count = 0;
  for (size_t first = 0; first < rays.size();) {
    const size_t count =
        std::min(first % EmbreeScene::kPacket + 1, rays.size() - first);  // all sizes in turn
    const std::span<const Ray> together(&rays[first], count);
    std::array<Hit, EmbreeScene::kPacket> hits;
    std::array<bool, EmbreeScene::kPacket> occluded;
    (*embree)->IntersectTogether(together, hits);
    (*embree)->AreOccludedTogether(together, occluded);
    for (size_t i = 0; i < count; ++i) {
      const Hit alone = (*embree)->Intersect(together[i]);
      ASSERT_EQ(hits[i].instance, alone.instance) << first + i;
      EXPECT_EQ(occluded[i], (*embree)->IsOccluded(together[i])) << first + i;
      if (alone.IsMiss()) continue;
      ++hit_count;
      EXPECT_EQ(hits[i].triangle, alone.triangle);
      EXPECT_NEAR(hits[i].distance, alone.distance, 1e-5f * alone.distance);
      EXPECT_NEAR(hits[i].u, alone.u, 1e-4f);
      EXPECT_NEAR(hits[i].v, alone.v, 1e-4f);
    }
    first += count;
  }
  EXPECT_GT(hit_count, 50);
  EXPECT_LT(hit_count, 400);
}

TEST(EmbreeScene, AnyNumberOfThreadsBuildsTheSameTree) {
  // Of coincident triangles, and of those around a vertex, the tree's order decides which one is hit.
  scene::Scene scene = RoomWithSheets();
  const scene::Mesh sphere = testing::SphereMesh(0.7f, 60, 0);
  for (int i = 0; i < 3; ++i) testing::Place(&scene, sphere);
  const auto expected = EmbreeScene::Create(scene);
  ASSERT_TRUE(expected.ok()) << expected.status();
  for (const int threads : {2, 3, 7, 16}) {
    const std::unique_ptr<TaskPool> builders = MakeTaskPool(threads);
    const auto embree = EmbreeScene::Create(scene, OpacityClassOf, builders.get());
    ASSERT_TRUE(embree.ok()) << embree.status();
    for (size_t i = 0; i < sphere.positions.size(); i += 3) {
      const scene::Vec3 inside = {0.1f, 0.2f, 0.1f};
      Ray ray = {{.origin = inside, .direction = Normalize(sphere.positions[i] - inside), .max_distance = 9}};
      ray.random_key = i;
      const Hit hit = (*embree)->Intersect(ray);
      const Hit same = (*expected)->Intersect(ray);
      ASSERT_EQ(hit.instance, same.instance) << threads << " threads, vertex " << i;
      ASSERT_EQ(hit.triangle, same.triangle) << threads << " threads, vertex " << i;
      ASSERT_EQ(hit.u, same.u);
      ASSERT_EQ(hit.distance, same.distance);
    }
  }
}

TEST(EmbreeScene, SharesVerticesThatNeedNoTransform) {
  scene::Mesh sphere = testing::SphereMesh(0.7f, 60, scene::kNone);
  sphere.positions.shrink_to_fit();
  ASSERT_EQ(sphere.positions.capacity(), sphere.positions.size());
  const auto bytes_of_tree = [](const scene::Scene& scene) {
    const int64_t before = bench::EmbreeBytes();
    const auto embree = EmbreeScene::Create(scene);
    EXPECT_TRUE(embree.ok()) << embree.status();
    return bench::EmbreeBytes() - before;
  };
  for (const int places : {1, 2}) {  // in world space, and as instances
    scene::Scene scene;
    testing::Place(&scene, sphere);
    scene.instances.resize(static_cast<size_t>(places), scene.instances[0]);
    const int64_t copied = bytes_of_tree(scene);
    std::vector<scene::Vec3>& positions = scene.meshes[0].positions;
    positions.reserve(positions.size() + 1);
    EXPECT_GE(copied - bytes_of_tree(scene), static_cast<int64_t>(sizeof(scene::Vec3) * positions.size()));
  }
}

TEST(EmbreeScene, AHitIsThePointOfItsTriangleOnTheRayAndKnowsItsFront) {
  // Placed once, thus in world space, and twice, thus as instances; one of each is mirrored.
  scene::Scene scene = RoomWithSheets();
  scene::Affine mirror = {{-1.2f, 0.2f, 0}, {0, 0.9f, 0.3f}, {0.1f, 0, 0.8f}, {0.3f, 0, 0}};
  ASSERT_LT(mirror.Determinant(), 0);
  testing::Place(&scene, testing::SphereMesh(0.5f, 3, 0));
  scene.instances.back().world_from_object = mirror;
  for (size_t i = 0, count = scene.instances.size(); i < count; ++i) {
    if (scene.instances[i].world_from_object.origin == scene::Vec3{0, 0, 0}) continue;
    mirror.origin = scene.instances[i].world_from_object.origin;
    scene.instances[i].world_from_object = mirror;
    break;  // the other one stays as it is
  }
  const auto embree = EmbreeScene::Create(scene);
  ASSERT_TRUE(embree.ok()) << embree.status();
  std::set<int> seen, mirrored;
  for (Ray ray : Bundle(800)) {
    ray.max_distance = std::numeric_limits<float>::infinity();
    if (ray.random_key % 2 == 0) ray.direction = -ray.direction;
    const Hit hit = (*embree)->Intersect(ray);
    if (hit.IsMiss()) continue;
    seen.insert(hit.instance);
    const scene::Instance& instance = scene.instances[static_cast<size_t>(hit.instance)];
    const scene::Mesh& mesh = scene.meshes[static_cast<size_t>(instance.mesh)];
    const auto corner = [&](size_t i) { return mesh.positions[mesh.triangles[3 * hit.triangle + i]]; };
    const scene::Vec3 a = corner(0);
    const scene::Vec3 along_b = corner(1) - a;
    const scene::Vec3 along_c = corner(2) - a;
    const scene::Affine& to_world = instance.world_from_object;
    if (to_world.Determinant() < 0) mirrored.insert(hit.instance);
    const scene::Vec3 point = to_world.Point(a + along_b * hit.u + along_c * hit.v);
    EXPECT_LT(Length(point - (ray.origin + ray.direction * hit.distance)), 1e-4f) << hit.instance;
    const scene::Vec3 in_front = to_world.Vector(Cross(along_b, along_c));
    EXPECT_GT(Dot(hit.face_normal, in_front), 0) << hit.instance;
    for (const scene::Vec3& edge : {along_b, along_c})
      EXPECT_NEAR(Dot(Normalize(hit.face_normal), Normalize(to_world.Vector(edge))), 0, 1e-4f);
  }
  EXPECT_GE(seen.size(), 6u);
  EXPECT_EQ(mirrored.size(), 2u);
}

}  // namespace
}  // namespace lumifold::render
