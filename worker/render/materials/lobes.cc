#include "worker/render/materials/lobes.h"

#include <algorithm>
#include <cmath>

#include "worker/render/materials/dispersion.h"
#include "worker/render/materials/microfacet.h"

namespace lumifold::render {
namespace {

/// Interpolated texels may lie outside the range of the texels by rounding.
constexpr float kRounding = 1e-5f;

/// Adds the lobe of a boundary whose GGX alpha is the square of a value in `roughness`.
void AddBoundary(ValueRange roughness, LobeSet* lobes) {
  lobes->delta |= roughness.min * roughness.min < kDeltaAlpha * (1.0f + kRounding);
  lobes->glossy |= roughness.max * roughness.max >= kDeltaAlpha * (1.0f - kRounding);
}

}  // namespace

LobeSet LobesOf(const scene::Material& m, TextureRanges* ranges) {
  LobeSet lobes;
  if (m.unlit) return lobes;
  const ValueRange metallic = ranges->Of(m.base.metallic_roughness_texture, 2) * m.base.metallic;
  const ValueRange transmission = ranges->Of(m.transmission.texture, 0) * m.transmission.factor;
  const ValueRange specular = ranges->Of(m.specular.factor_texture, 3) * m.specular.factor;
  lobes.diffuse = metallic.min < 1 && transmission.min < 1 && MaxComponent(m.base.color) > 0;
  lobes.glossy = m.base.diffuse_transmission.factor > 0;
  if (metallic.max > 0 || transmission.max > 0 || specular.max > 0) {
    AddBoundary(ranges->Of(m.base.metallic_roughness_texture, 1) * m.base.roughness, &lobes);
    lobes.glossy |= m.base.anisotropy.strength > 0;  // where there are tangents
  }
  const float least_ior = DispersedIor(m.ior, m.volume.dispersion, -kMaxShift);
  if (transmission.max > 0 && m.volume.is_solid && std::abs(least_ior - 1.0f) < kMinIorDifference)
    lobes.delta = true;
  if ((ranges->Of(m.clearcoat.factor_texture, 0) * m.clearcoat.factor).max > 0)
    AddBoundary(ranges->Of(m.clearcoat.roughness_texture, 1) * m.clearcoat.roughness, &lobes);
  if (MaxComponent(m.sheen.color) > 0) lobes.glossy = true;
  return lobes;
}

const scene::Material& MaterialOf(const scene::Scene& scene, const scene::Mesh& mesh) {
  static const auto* const default_material = new scene::Material;
  return mesh.material == scene::kNone ? *default_material : scene.materials[mesh.material];
}

bool IsDiffuseOnly(const scene::Scene& scene) {
  TextureRanges ranges(scene);
  return std::all_of(scene.instances.begin(), scene.instances.end(), [&](const scene::Instance& instance) {
    const LobeSet lobes = LobesOf(MaterialOf(scene, scene.meshes[instance.mesh]), &ranges);
    return !lobes.glossy && !lobes.delta;
  });
}

}  // namespace lumifold::render
