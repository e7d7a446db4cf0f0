#pragma once

#include "worker/render/tracing/layer_sample.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The surface at one level of a branch. Its normal is reflected by the mirrors of the chain, so that a flat
/// mirror is equivalent to a window into the mirrored room.
struct LevelGeometry {
  bool valid = false;  // a surface with a diffuse lobe
  scene::Vec3 normal;
  float distance = 0;  // along the whole chain of delta events
  int instance = scene::kNone;
};

/// Geometry along the ray through a picture point, without random decisions: at smooth glass that is seen
/// first both branches are followed, at every other surface the stronger delta event.
struct GeometrySample {
  bool hit = false;
  bool valid = false;  // a surface with a diffuse lobe
  scene::Vec3 position;
  scene::Vec3 normal;     // shading normal, towards the camera
  scene::Vec3 geometric;  // face normal, towards the camera
  float distance = 0;
  int instance = scene::kNone;
  float roughness = 1;  // GGX alpha of the reflecting lobe; 1 if there is none
  scene::Vec3 albedo;   // T
  scene::Vec3 emitted;  // E; the environment's if nothing is hit
  ByLevel<LevelGeometry> levels;
};

}  // namespace lumifold::render
