// Closed surfaces let no ray through, and no light.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/mix_bits.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/processor.h"

namespace lumifold::render {
namespace {

using scene::Mesh;
using scene::Scene;
using scene::Vec3;

/// Uniform numbers in [0, 1), the same on every machine.
class Numbers {
 public:
  float Next() { return static_cast<float>(MixBits(++state_) >> 40) * 0x1p-24f; }
  Vec3 Direction() {
    for (;;) {
      const Vec3 v = {2 * Next() - 1, 2 * Next() - 1, 2 * Next() - 1};
      if (LengthSquared(v) > 0.01f && LengthSquared(v) <= 1) return Normalize(v);
    }
  }

 private:
  uint64_t state_ = 0;
};

/// Turned about an axis without symmetry, so that no coordinate is 0 or 1.
Vec3 Turned(Vec3 v) {
  const Vec3 axis = Normalize(Vec3{0.3f, 0.7f, -0.4f});
  return v * std::cos(0.83f) + Cross(axis, v) * std::sin(0.83f) +
         axis * (Dot(axis, v) * (1 - std::cos(0.83f)));
}

/// The box [-1, 1]^3 times `half`, turned, of faces of n x n quads each. Neighbouring faces share positions,
/// not vertices.
Mesh TurnedBox(int n, Vec3 half) {
  Mesh mesh;
  mesh.material = 0;
  const auto steps = static_cast<uint32_t>(n);
  const auto at = [n](uint32_t step) { return 2 * static_cast<float>(step) / static_cast<float>(n) - 1; };
  for (int face = 0; face < 6; ++face) {
    const auto first = static_cast<uint32_t>(mesh.positions.size());
    for (uint32_t j = 0; j <= steps; ++j) {
      for (uint32_t i = 0; i <= steps; ++i) {
        const std::array<float, 3> p = {face % 2 == 0 ? -1.0f : 1.0f, at(i), at(j)};
        mesh.positions.push_back(Turned({p[static_cast<size_t>(face / 2)] * half.x,
                                         p[static_cast<size_t>(face / 2 + 1) % 3] * half.y,
                                         p[static_cast<size_t>(face / 2 + 2) % 3] * half.z}));
      }
    }
    for (uint32_t j = 0; j < steps; ++j) {
      for (uint32_t i = 0; i < steps; ++i) {
        const uint32_t a = first + j * (steps + 1) + i;
        const uint32_t d = a + steps + 2;
        mesh.triangles.insert(mesh.triangles.end(), {a, a + 1, d, a, d, d - 1});
      }
    }
  }
  return mesh;
}

struct ClosedMesh {
  std::string name;
  Mesh mesh;
  float inside;            // radius of a ball inside, around the origin
  Vec3 shift = {0, 0, 0};  // of the mesh
  bool instanced = false;
  double misses_at_edges = 0;  // share of rays that are allowed to miss
};

std::vector<ClosedMesh> ClosedMeshes() {
  return {{"box", TurnedBox(1, {1, 1, 1}), 0.8f},
          {"box far away", TurnedBox(1, {1, 1, 1}), 0.8f, {3000, 2000, 1000}},
          {"flat box, grazing rays", TurnedBox(1, {1, 0.01f, 1}), 0.008f},
          {"box of many triangles", TurnedBox(64, {1, 1, 1}), 0.8f},
          {"sphere", testing::SphereMesh(1, 32, 0), 0.8f},
          {"sphere of 320000 triangles", testing::SphereMesh(1, 200, 0), 0.8f},
          {"the same, instanced", testing::SphereMesh(1, 200, 0), 0.8f, {0, 0, 0}, true},
          {"the same, far away", testing::SphereMesh(1, 200, 0), 0.8f, {300, 200, 100}, false, 1e-4}};
}

Scene SceneOf(const ClosedMesh& closed, float scale) {
  Scene scene;
  scene.materials = {testing::Lambert({0.9f, 0.9f, 0.9f})};
  Mesh mesh = closed.mesh;
  for (Vec3& p : mesh.positions) p = (p + closed.shift) * scale;
  testing::Place(&scene, std::move(mesh));
  if (closed.instanced) {
    scene.instances.push_back(scene.instances[0]);
    scene.instances[1].world_from_object.origin = {1e3f * scale, 0, 0};
  }
  return scene;
}

/// Rays that found no surface, of those from inside to random points on edges, to vertices, and in random
/// directions.
struct Misses {
  int64_t edges = 0;
  int64_t vertices = 0;
  int64_t anywhere = 0;
};

class MissCounter {
 public:
  explicit MissCounter(const EmbreeScene& embree) : embree_(embree) {}

  int64_t Count(Vec3 origin, Vec3 target) const {
    Ray ray;
    ray.origin = origin;
    ray.direction = Normalize(target - origin);
    bool occluded = false;
    Hit hit;
    embree_.AreOccludedTogether({&ray, 1}, {&occluded, 1});
    embree_.IntersectTogether({&ray, 1}, {&hit, 1});
    const bool all_hit =
        !embree_.Intersect(ray).IsMiss() && !hit.IsMiss() && embree_.IsOccluded(ray) && occluded;
    return all_hit ? 0 : 1;
  }

 private:
  const EmbreeScene& embree_;
};

constexpr int kRays = 20000;

Misses CountMisses(const ClosedMesh& closed, float scale) {
  const Scene scene = SceneOf(closed, scale);
  const auto embree = *EmbreeScene::Create(scene);
  const MissCounter counter(*embree);
  const Mesh& mesh = scene.meshes[0];
  const auto triangles = static_cast<float>(mesh.triangles.size() / 3);
  Numbers numbers;
  Misses misses;
  for (size_t i = 0; i < kRays; ++i) {
    const Vec3 origin = (closed.shift + numbers.Direction() * (closed.inside * numbers.Next())) * scale;
    const auto first = 3 * static_cast<size_t>(numbers.Next() * triangles);
    const Vec3 a = mesh.positions[mesh.triangles[first + i % 3]];
    const Vec3 b = mesh.positions[mesh.triangles[first + (i + 1) % 3]];
    misses.edges += counter.Count(origin, Lerp(a, b, numbers.Next()));
    misses.vertices += counter.Count(origin, a);
    misses.anywhere += counter.Count(origin, origin + numbers.Direction() * scale);
  }
  return misses;
}

TEST(Watertight, RaysToEdgesVerticesAndFacesOfClosedMeshesHit) {
  const ScopedFloatEnvironment environment;
  for (const ClosedMesh& closed : ClosedMeshes()) {
    for (const float scale : {1e-3f, 1.0f, 1e5f}) {
      SCOPED_TRACE(::testing::Message() << closed.name << ", scale " << scale);
      const Misses misses = CountMisses(closed, scale);
      EXPECT_EQ(misses.anywhere, 0);
      EXPECT_LE(static_cast<double>(misses.edges), closed.misses_at_edges * kRays);
      // Embree's robust mode is not exact where several triangles meet; without it a fifth to a third misses.
      EXPECT_LT(static_cast<double>(misses.vertices), 0.04 * kRays);
    }
  }
}

/// A closed room of white walls without lamps, below a bright sky: any light has come through a wall.
LayeredImage RoomBelowSky(const ClosedMesh& closed, float scale) {
  constexpr int kSize = 32;
  Scene scene = SceneOf(closed, scale);
  const Vec3 eye = closed.shift + Vec3{0.1f, 0.02f, 0.05f} * closed.inside;
  scene.cameras = {testing::LookAt(eye * scale, (eye + Vec3{-1, 0.1f, -0.3f}) * scale, 2.0f)};
  LayeredImage sky(4, 2);
  for (const FloatView& channel : sky.AddColor("")) {
    for (int x = 0; x < 4; ++x) channel.At(x, 0) = channel.At(x, 1) = 1e6f;
  }
  RenderSettings settings = SettingsOf(kSize, kSize);
  settings.environment = *Environment::Create(sky, 0, 1);
  return RenderAll(*MakeRenderer(std::move(scene), settings), kSize, kSize, 16);
}

TEST(Watertight, ABrightSkyLightsNoPixelOfAClosedRoom) {
  for (const ClosedMesh& closed : ClosedMeshes()) {
    if (LengthSquared(closed.shift) > 0) continue;  // there rays begin a rounding error beside their surface
    for (const float scale : {1e-3f, 1.0f, 1e5f}) {
      const LayeredImage picture = RoomBelowSky(closed, scale);
      EXPECT_EQ(MeanOf(picture, layers::kNoisy), 0) << closed.name << ", scale " << scale;
    }
  }
}

}  // namespace
}  // namespace lumifold::render
