#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "filter/image/parallel.h"
#include "worker/render/lanes/vertex_lanes.h"
#include "worker/render/materials/opacity.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

struct Ray : RayRecord {
  uint64_t random_key = 0;  // unique to the ray: decides which half-transparent surfaces it hits

  float WidthAt(float distance) const { return width + spread * distance; }
};

/// Intersection of a ray with a triangle. It includes the normal, so that flat surfaces need no mesh lookup.
struct Hit {
  int instance = scene::kNone;  // kNone: nothing was hit
  uint32_t triangle = 0;        // within the instance's mesh
  float u = 0;                  // barycentric weights of the triangle's second and third vertex
  float v = 0;
  float distance = 0;
  scene::Vec3 face_normal;  // world space, not normalised, on the front (counter-clockwise) side

  bool IsMiss() const { return instance == scene::kNone; }
};

/// Consecutive hits of a ray with transparent surfaces (OpacityClass::kTransparent), nearest first.
struct TransparentHits {
  static constexpr int kMaxHits = 8;
  std::array<Hit, kMaxHits> hits;
  int count = 0;
};

/// "embree3" or "embree4": the major version that the renderer is built with, part of the numeric class.
const char* EmbreeName();

/// A scene in Embree. A mesh with one instance is transformed to world space; a mesh with several is an
/// Embree instance. Threads: after Create() all calls are safe concurrently. The acceleration
/// structure, and with it the choice between surfaces at equal distance, does not depend on the number of
/// threads that build it.
class EmbreeScene {
 public:
  /// Keeps pointers to the scene and its triangles, which must outlive it. `opacity` and `builders`, whose
  /// threads build the acceleration structure (null: this thread), are used by this call only.
  /// Errors: kResourceExhausted if memory runs out; kInternal if Embree fails.
  static absl::StatusOr<std::unique_ptr<EmbreeScene>> Create(const scene::Scene& scene,
                                                             const OpacitySource& opacity = OpacityClassOf,
                                                             TaskPool* builders = nullptr);
  virtual ~EmbreeScene() = default;

  /// The nearest triangle on the ray that is not cut out. A half-transparent one is hit with its opacity as
  /// probability; the ray's random key and the triangle decide.
  virtual Hit Intersect(const Ray& ray) const = 0;

  /// The same for rays that have nothing to do with each other.
  virtual void IntersectEach(std::span<const Ray* const> rays, std::span<Hit> hits) const = 0;

  /// Whether a surface that is not OpacityClass::kTransparent lies on the ray before its max_distance.
  virtual bool IsOccluded(const Ray& ray) const = 0;

  /// Maximum number of rays that are traced together.
  static constexpr size_t kPacket = 8;
  /// The same for up to kPacket rays, much faster if they are coherent. Which of two triangles at equal
  /// distance is hit may depend on the other rays.
  virtual void IntersectTogether(std::span<const Ray> rays, std::span<Hit> hits) const = 0;
  virtual void AreOccludedTogether(std::span<const Ray> rays, std::span<bool> occluded) const = 0;

  bool HasTransparentSurfaces() const { return has_transparent_; }
  /// The transparent surfaces on the ray before its max_distance, whatever their opacity at the hit, nearest
  /// first, at equal distance in order of instance and triangle. Returns those after `last` (null: all), at
  /// most TransparentHits::kMaxHits. The scene must have transparent surfaces.
  virtual TransparentHits FindTransparentHits(const Ray& ray, const Hit* last) const = 0;

 protected:
  bool has_transparent_ = false;
};

/// Rays that the calling thread has traced so far, in all scenes: the cost of what it does that is the same
/// on every machine of a numeric class.
int64_t RaysOfThread();

}  // namespace lumifold::render
