#pragma once

#include <optional>

#include "worker/scene/vec.h"

namespace lumifold::scene {

/// v scaled to unit length in double, where no float can overflow or vanish; nullopt for zero. v must be
/// finite.
std::optional<Vec3> UnitVector(Vec3 v);

/// Some unit vector at right angles to the unit vector n.
Vec3 Perpendicular(Vec3 n);

}  // namespace lumifold::scene
