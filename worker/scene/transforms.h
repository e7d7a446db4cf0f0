#pragma once

#include <array>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/tinygltf.h"
#include "worker/scene/vec.h"

namespace lumifold::scene {

/// The transform translation * rotation * scale; `rotation` is a quaternion (x, y, z, w) of any length.
/// Error: it is zero.
absl::StatusOr<Affine> AffineFromTrs(Vec3 translation, Vec4 rotation, Vec3 scale);

/// A node's matrix, or its translation, rotation and scale. Errors: kInvalidArgument for wrong lengths,
/// values that are not finite, a projective matrix.
absl::StatusOr<Affine> LocalTransform(const tinygltf::Node& node);

/// A point in double precision: the origins of nodes of a scene that lies far from its own origin, such as a
/// town in map coordinates, whose differences count.
using Point64 = std::array<double, 3>;

/// The translation of LocalTransform, as the file has it.
Point64 LocalOrigin(const tinygltf::Node& node);

/// Whether the transform is finite and can be inverted in float.
bool IsInvertible(const Affine& affine);

/// The same origin and directions (of -z, then of +y) without scale, shear or mirroring; `affine` must be
/// invertible.
Affine RigidPart(const Affine& affine);

}  // namespace lumifold::scene
