#pragma once

#include <optional>

#include "worker/scene/vec.h"

namespace lumifold::scene {

/// v scaled to unit length, computed in double, where no float overflows or underflows; nullopt for zero. v
/// must be finite.
std::optional<Vec3> UnitVector(Vec3 v);

/// A unit vector perpendicular to the unit vector n.
Vec3 Perpendicular(Vec3 n);

}  // namespace lumifold::scene
