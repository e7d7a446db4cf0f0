#pragma once

#include <cstdint>
#include <string>

#include "worker/render/materials/lobes.h"
#include "worker/scene/scene.h"

namespace lumifold::plan {

/// What the rules of a plan read from a scene. A fact holds for all frames of an animated scene: there the
/// materials of the whole file count, also those of surfaces that a transform hides in this frame, and
/// nothing is known about where surfaces are.
struct SceneFacts {
  bool animated = false;
  int64_t surfaces = 0;             // instances with triangles
  bool in_one_plane = false;        // all surfaces are: no light is scattered from one to another
  render::LobeSet lobes;            // of all surfaces together
  std::string glossy_material;      // the first with a glossy or delta lobe: "material 'steel'"; empty: none
  std::string delta_material;       // the first with a delta lobe
  bool delta_in_one_plane = false;  // all surfaces with delta lobes are

  bool emitters = false;  // surfaces that emit, unlit ones included
  bool environment = false;
  bool punctual = false;

  int64_t alpha_surfaces = 0;   // with OpacityClass other than kOpaque by their settings
  int64_t opaque_surfaces = 0;  // of these, kOpaque by their texels and vertex colours

  bool HasLight() const { return emitters || environment || punctual; }
  bool IsDiffuseOnly() const { return !lobes.glossy && !lobes.delta; }
};

SceneFacts FactsOf(const scene::Scene& scene, bool has_environment);

}  // namespace lumifold::plan
