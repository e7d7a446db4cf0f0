#include "worker/render/tracing/visibility.h"

#include <array>

#include "worker/render/materials/bsdf.h"
#include "worker/render/materials/opacity.h"

namespace lumifold::render {

void Visibility::Transmittances(std::span<const Ray> rays, std::span<Vec3> transmittances) const {
  std::array<bool, EmbreeScene::kPacket> occluded;
  embree_->AreOccludedTogether(rays, occluded);
  for (size_t i = 0; i < rays.size(); ++i) {
    if (occluded[i]) {
      transmittances[i] = {0, 0, 0};
    } else {
      transmittances[i] =
          embree_->HasTransparentSurfaces() ? ThroughTransparentSurfaces(rays[i]) : Vec3{1, 1, 1};
    }
  }
}

Vec3 Visibility::ThroughTransparentSurfaces(const Ray& ray) const {
  Vec3 transmittance = {1, 1, 1};
  TransparentHits found = embree_->FindTransparentHits(ray, nullptr);
  for (;;) {
    for (int i = 0; i < found.count; ++i) {
      transmittance *= TransmittanceOfHit(found.hits[i], ray);
      if (MaxComponent(transmittance) <= 0) return transmittance;
    }
    if (found.count < TransparentHits::kMaxHits) return transmittance;
    const Hit last = found.hits.back();
    found = embree_->FindTransparentHits(ray, &last);
  }
}

Vec3 Visibility::TransmittanceOfHit(const Hit& hit, const Ray& ray) const {
  const scene::Mesh& mesh = scene_->meshes[scene_->instances[hit.instance].mesh];
  const float opacity = OpacityAt(*scene_, mesh, hit.triangle, hit.u, hit.v);
  const Vec3 past = Vec3{1, 1, 1} * (1.0f - opacity);
  if (opacity <= 0 || scene_->materials[mesh.material].transmission.factor <= 0) return past;
  const Surface surface = surfaces_->Read(hit, ray);
  const Bsdf bsdf(surfaces_->Shade(surface), *albedos_, surface.normal, surface.geometric, -ray.direction);
  return past + bsdf.StraightTransmittance() * opacity;
}

}  // namespace lumifold::render
