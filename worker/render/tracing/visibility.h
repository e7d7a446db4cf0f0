#pragma once

#include <span>

#include "worker/render/materials/albedo_table.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/surface.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// Transmittance along straight lines: 1 through holes, 1 - alpha through half-transparent surfaces, the
/// transmittance of clear panes. Threads: safe concurrently. Keeps pointers to its constructor's arguments.
class Visibility {
 public:
  Visibility(const scene::Scene& scene, const EmbreeScene& embree, const SurfaceReader& surfaces,
             const AlbedoTable& albedos)
      : scene_(&scene), embree_(&embree), surfaces_(&surfaces), albedos_(&albedos) {}

  /// The fraction of light that passes from one end of the ray to the other.
  Vec3 Transmittance(const Ray& ray) const {
    if (embree_->IsOccluded(ray)) return {0, 0, 0};
    return embree_->HasTransparentSurfaces() ? ThroughTransparentSurfaces(ray) : Vec3{1, 1, 1};
  }
  /// The same for up to EmbreeScene::kPacket rays, faster if they are coherent.
  void Transmittances(std::span<const Ray> rays, std::span<Vec3> transmittances) const;

 private:
  Vec3 ThroughTransparentSurfaces(const Ray& ray) const;
  Vec3 TransmittanceOfHit(const Hit& hit, const Ray& ray) const;

  const scene::Scene* scene_;
  const EmbreeScene* embree_;
  const SurfaceReader* surfaces_;
  const AlbedoTable* albedos_;
};

}  // namespace lumifold::render
