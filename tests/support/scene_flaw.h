#pragma once

#include <string>

#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Names the first thing in `scene` that a Scene out of the loader must not have: an index out of range, a
/// number that is not finite, a vector of another length than it should have. Empty for a valid scene.
std::string FirstFlaw(const Scene& scene);

}  // namespace lumifold::scene
