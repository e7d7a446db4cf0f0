#pragma once

#include "worker/render/textures/texture_ranges.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The lobes that a material's BSDF has at some point, as far as factors and textures tell: none is missing,
/// but one that is set may exist nowhere.
struct LobeSet {
  bool diffuse = false;
  bool glossy = false;  // rough reflection, rough transmission, sheen, diffuse transmission
  bool delta = false;   // reflection or transmission at a perfectly smooth boundary

  bool IsEmpty() const { return !diffuse && !glossy && !delta; }
  LobeSet& operator|=(const LobeSet& other) {
    diffuse |= other.diffuse;
    glossy |= other.glossy;
    delta |= other.delta;
    return *this;
  }
};

LobeSet LobesOf(const scene::Material& material, TextureRanges* ranges);

/// The material of a mesh; glTF's default material if it names none.
const scene::Material& MaterialOf(const scene::Scene& scene, const scene::Mesh& mesh);

/// Whether SurfaceMaterial::IsDiffuseOnly() holds everywhere in the scene.
bool IsDiffuseOnly(const scene::Scene& scene);

}  // namespace lumifold::render
