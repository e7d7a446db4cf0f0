#pragma once

#include "worker/render/layer_sample.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The surface at one level of a branch. A normal seen in mirrors is mirrored back through them, so that a
/// flat mirror shows the room as a window would.
struct LevelGeometry {
  bool valid = false;  // a surface with a diffuse lobe
  scene::Vec3 normal;
  float distance = 0;  // along the whole chain
  int instance = scene::kNone;
};

/// What the ray through a picture point meets, without any chance in it: at smooth glass both branches are
/// followed, at every other surface, and behind the first, the stronger perfectly specular event.
struct GeometrySample {
  bool hit = false;
  bool valid = false;  // a surface with a diffuse lobe
  scene::Vec3 position;
  scene::Vec3 normal;     // shading normal, towards the camera
  scene::Vec3 geometric;  // face normal, towards the camera
  float distance = 0;
  int instance = scene::kNone;
  float roughness = 1;  // GGX alpha of the reflecting lobe; 1 where there is none
  scene::Vec3 albedo;   // T
  scene::Vec3 emitted;  // E; the sky's where nothing is hit
  ByLevel<LevelGeometry> levels;
};

}  // namespace lumifold::render
