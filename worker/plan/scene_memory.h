#pragma once

#include <cstdint>

#include "worker/scene/scene.h"

namespace lumifold::plan {

/// Memory that a worker needs to render a scene, an estimate: the scene's arrays, its pictures with their mip
/// levels, the acceleration structure while it is built, and what a process takes anyway. An animation has
/// the geometry of two frames. `file_bytes`: of the scene's files, which are in memory while it is loaded;
/// `environment_bytes`: of its sky.
uint64_t SceneMemory(const scene::Scene& scene, uint64_t file_bytes, uint64_t environment_bytes);

}  // namespace lumifold::plan
