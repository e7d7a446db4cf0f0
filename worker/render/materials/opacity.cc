#include "worker/render/materials/opacity.h"

#include <algorithm>

#include "worker/render/materials/microfacet.h"
#include "worker/render/textures/texture.h"

namespace lumifold::render {
namespace {

using scene::Material;
using scene::Mesh;
using scene::Scene;

/// A cutoff above 1 masks everything out, alpha or not.
bool HasAlpha(const Material& material, const Mesh& mesh) {
  if (material.alpha_mode == scene::AlphaMode::kMask && material.alpha_cutoff > 1) return true;
  return material.alpha_mode != scene::AlphaMode::kOpaque &&
         (material.base.alpha < 1 || material.base.color_texture.texture != scene::kNone ||
          !mesh.colors.empty());
}

/// Whether Bsdf::StraightTransmittance may be above 0 anywhere on the material.
bool MayBeClearPane(const Material& material) {
  const bool smooth = material.base.roughness * material.base.roughness < kDeltaAlpha ||
                      material.base.metallic_roughness_texture.texture != scene::kNone;
  return material.transmission.factor > 0 && !material.volume.is_solid && !material.unlit && smooth;
}

/// Whether every point of the mesh has opacity 1.
bool IsOpaqueEverywhere(const Material& material, const Mesh& mesh, TextureRanges* ranges) {
  constexpr float kRounding = 1e-5f;  // interpolated alpha may lie below the least of the texels
  float least = material.base.alpha * ranges->Of(material.base.color_texture, 3).min;
  if (!mesh.colors.empty()) {
    const auto lowest =
        std::min_element(mesh.colors.begin(), mesh.colors.end(),
                         [](const scene::Vec4& a, const scene::Vec4& b) { return a.w < b.w; });
    least *= lowest->w;
  }
  // Sums of ones weighted by barycentric coordinates may lie below 1.
  if (material.alpha_mode == scene::AlphaMode::kBlend) return least >= 1 && mesh.colors.empty();
  return least * (1.0f - kRounding) >= material.alpha_cutoff;
}

OpacityClass ClassOf(const Material& material, bool has_alpha) {
  if (MayBeClearPane(material) || (has_alpha && material.alpha_mode == scene::AlphaMode::kBlend))
    return OpacityClass::kTransparent;
  return has_alpha ? OpacityClass::kMasked : OpacityClass::kOpaque;
}

}  // namespace

OpacityClass OpacityClassOf(const Scene& scene, const Mesh& mesh) {
  if (mesh.material == scene::kNone) return OpacityClass::kOpaque;
  const Material& material = scene.materials[mesh.material];
  return ClassOf(material, HasAlpha(material, mesh));
}

OpacityClass ScannedOpacityClassOf(const Scene& scene, const Mesh& mesh, TextureRanges* ranges) {
  if (mesh.material == scene::kNone) return OpacityClass::kOpaque;
  const Material& material = scene.materials[mesh.material];
  return ClassOf(material, HasAlpha(material, mesh) && !IsOpaqueEverywhere(material, mesh, ranges));
}

float OpacityAt(const Scene& scene, const Mesh& mesh, uint32_t triangle, float u, float v) {
  if (mesh.material == scene::kNone) return 1;
  const Material& material = scene.materials[mesh.material];
  if (!HasAlpha(material, mesh)) return 1;
  const uint32_t* corners = &mesh.triangles[static_cast<size_t>(triangle) * 3];
  const float w = 1.0f - u - v;
  float alpha = material.base.alpha;
  if (!mesh.colors.empty()) {
    const auto at = [&](int corner) { return mesh.colors[corners[corner]].w; };
    alpha *= at(0) * w + at(1) * u + at(2) * v;
  }
  const scene::TextureRef& ref = material.base.color_texture;
  if (ref.texture != scene::kNone) {
    scene::Vec2 uv;
    const auto& uvs = mesh.uvs[ref.uv_set];
    if (!uvs.empty()) uv = uvs[corners[0]] * w + uvs[corners[1]] * u + uvs[corners[2]] * v;
    alpha *= SampleAlpha(scene, ref, uv);
  }
  if (material.alpha_mode == scene::AlphaMode::kMask) return alpha >= material.alpha_cutoff ? 1.0f : 0.0f;
  return alpha;
}

}  // namespace lumifold::render
