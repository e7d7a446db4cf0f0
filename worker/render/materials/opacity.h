#pragma once

#include <cstdint>
#include <functional>

#include "worker/render/textures/texture_ranges.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// Opacity class of a mesh: which rays may pass through it.
enum class OpacityClass {
  kOpaque,       // none
  kMasked,       // all or none at each point: alphaMode MASK
  kTransparent,  // a fraction at each point: alphaMode BLEND, and panes of clear thin glass
};

/// From the material's settings alone.
OpacityClass OpacityClassOf(const scene::Scene& scene, const scene::Mesh& mesh);
/// The same, but kOpaque where the texels and vertex colours show that nothing is cut out.
OpacityClass ScannedOpacityClassOf(const scene::Scene& scene, const scene::Mesh& mesh, TextureRanges* ranges);

/// One of the two functions.
using OpacitySource = std::function<OpacityClass(const scene::Scene& scene, const scene::Mesh& mesh)>;

/// Opacity at the point with barycentric weights u and v of a triangle's second and third vertex: 1 for an
/// opaque material, 1 or 0 for a mask, else alpha = base colour factor times texture (bilinear, without
/// footprint) times vertex colour.
float OpacityAt(const scene::Scene& scene, const scene::Mesh& mesh, uint32_t triangle, float u, float v);

}  // namespace lumifold::render
