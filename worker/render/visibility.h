#pragma once

#include <span>

#include "worker/render/albedo_table.h"
#include "worker/render/embree_scene.h"
#include "worker/render/surface.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// How much light gets along a straight line: through holes all of it, through half-transparent surfaces what
/// their alpha leaves, through clear panes what they transmit. Threads: safe concurrently. Keeps pointers to
/// what it is given.
class Visibility {
 public:
  Visibility(const scene::Scene& scene, const EmbreeScene& embree, const SurfaceReader& surfaces,
             const AlbedoTable& albedos)
      : scene_(&scene), embree_(&embree), surfaces_(&surfaces), albedos_(&albedos) {}

  /// The share that gets from one end of the ray to the other.
  Vec3 Transmittance(const Ray& ray) const {
    if (embree_->IsOccluded(ray)) return {0, 0, 0};
    return embree_->HasVeils() ? ThroughVeils(ray) : Vec3{1, 1, 1};
  }
  /// The same of up to EmbreeScene::kPacket rays, faster where they lie side by side.
  void Transmittances(std::span<const Ray> rays, std::span<Vec3> shares) const;

 private:
  Vec3 ThroughVeils(const Ray& ray) const;
  Vec3 ThroughVeil(const Hit& hit, const Ray& ray) const;

  const scene::Scene* scene_;
  const EmbreeScene* embree_;
  const SurfaceReader* surfaces_;
  const AlbedoTable* albedos_;
};

}  // namespace lumifold::render
