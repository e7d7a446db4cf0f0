#pragma once

#include <array>

namespace lumifold {

/// Names the surface at a point that a camera ray hits first, so that the samples of a pixel that hit one
/// surface can be kept together: a whole number in [1, 2^24), equal for equal object and cell of the normal,
/// which is the axis that the normal follows most, with its sign. Nothing depends on the unit of length. A
/// smooth surface that crosses the border of a cell has two names, and two surfaces have one name by chance
/// once in 2^24: both are valid, because each name's samples have features of their own. `object_id` is that
/// of layers::kObjectId, `normal` points towards the camera, `distance` is along the ray. Returns 0 where
/// nothing is hit (object_id below 1) and where a number is not finite or the distance not above 0. The same
/// bits on every machine.
float SurfaceKey(float object_id, std::array<float, 3> normal, float distance);

}  // namespace lumifold
