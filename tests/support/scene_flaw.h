#pragma once

#include <string>

#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Names the first property of `scene` that a Scene from the loader must not have: an index out of range, a
/// number that is not finite, a vector of the wrong length. Empty for a valid scene.
std::string FirstFlaw(const Scene& scene);

}  // namespace lumifold::scene
