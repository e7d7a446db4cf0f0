#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

struct Ray {
  scene::Vec3 origin;
  scene::Vec3 direction;  // unit
  float max_distance = std::numeric_limits<float>::infinity();
  uint64_t chance = 0;  // a number of its own: decides which half-transparent surfaces it meets or passes
  float width = 0;   // metres across of the cone round the ray at its origin, for textures; 0 and 0: a line
  float spread = 0;  // by how much the cone widens a metre

  float WidthAt(float distance) const { return width + spread * distance; }
};

/// Where a ray met a triangle. The normal comes with the hit, so that flat surfaces need no look into their
/// mesh.
struct Hit {
  int instance = scene::kNone;  // kNone: nothing was hit
  uint32_t triangle = 0;        // within the instance's mesh
  float u = 0;                  // barycentric weights of the triangle's second and third corner
  float v = 0;
  float distance = 0;
  scene::Vec3 face_normal;  // world space, any length, on the front (counter-clockwise) side

  bool IsMiss() const { return instance == scene::kNone; }
};

/// Some surfaces on a ray, in order.
struct Veils {
  static constexpr int kMost = 8;
  std::array<Hit, kMost> hits;
  int count = 0;
};

/// The instruction set rays are traced with, part of the numeric class: "avx2" where the processor has it,
/// else "sse4.2".
const char* TracingInstructionSet();

/// A scene in Embree. Meshes placed once are baked into world space, those placed more often are Embree
/// instances. Threads: after Create() all calls are safe concurrently. Built on one thread, so that the tree,
/// and with it the choice between surfaces at equal distance, is the same everywhere.
class EmbreeScene {
 public:
  /// Keeps a pointer to the scene, which must outlive it. Errors: kResourceExhausted when memory runs out;
  /// kInternal with Embree's words.
  static absl::StatusOr<std::unique_ptr<EmbreeScene>> Create(const scene::Scene& scene);
  virtual ~EmbreeScene() = default;

  /// The nearest triangle on the ray, holes apart. A half-transparent one is met with its opacity as
  /// probability, decided by the ray's chance and the triangle.
  virtual Hit Intersect(const Ray& ray) const = 0;

  /// Whether anything lies on the ray before its max_distance that is no veil (Openness).
  virtual bool IsOccluded(const Ray& ray) const = 0;

  /// How many rays can be traced together.
  static constexpr size_t kPacket = 8;
  /// The same of up to kPacket rays, much faster where they lie side by side. Which of two triangles at equal
  /// distance is met may depend on the ray's company.
  virtual void IntersectTogether(std::span<const Ray> rays, std::span<Hit> hits) const = 0;
  virtual void AreOccludedTogether(std::span<const Ray> rays, std::span<bool> occluded) const = 0;

  bool HasVeils() const { return has_veils_; }
  /// The veils on the ray before its max_distance, whatever their opacity, from the nearest on (at equal
  /// distance in order of instance and triangle); as many as `Veils` holds, beginning beyond `last`, which is
  /// null for all. There must be veils in the scene.
  virtual Veils VeilsOn(const Ray& ray, const Hit* last) const = 0;

 protected:
  bool has_veils_ = false;
};

}  // namespace lumifold::render
