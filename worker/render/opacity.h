#pragma once

#include <cstdint>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// What of a mesh light and sight may pass.
enum class Openness {
  kSolid,  // nothing
  kHoles,  // whole parts of it are cut out (alphaMode MASK)
  kVeil,   // any share anywhere: alphaMode BLEND, and panes of clear thin glass
};

Openness OpennessOf(const scene::Scene& scene, const scene::Mesh& mesh);

/// How much of it there is at the point with barycentric weights u and v of a triangle's second and third
/// corner: 1 where the material is opaque, 1 or 0 where it is a mask, else its alpha: base colour factor
/// times texture (between texels, never blurred) times vertex colour.
float OpacityAt(const scene::Scene& scene, const scene::Mesh& mesh, uint32_t triangle, float u, float v);

}  // namespace lumifold::render
