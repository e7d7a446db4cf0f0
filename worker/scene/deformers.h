#pragma once

#include <span>
#include <vector>

#include "absl/status/status.h"
#include "worker/scene/document.h"
#include "worker/scene/vertex_source.h"

namespace lumifold::scene {

/// How one placement bends its mesh.
struct Deformation {
  std::span<const double> morph_weights;    // one a morph target; empty: none applied
  std::span<const Affine> world_from_bind;  // one a joint of the skin; empty: not skinned
};

/// Adds the morph targets of `primitive`, each times its weight, to positions, normals and tangents of
/// `mesh`, which holds all vertices of the primitive. Targets of weight 0 are not read; each other one takes
/// its vertices off `budget`. Errors: kInvalidArgument for another number of weights than targets, or for
/// accessors that do not fit; kResourceExhausted.
absl::Status ApplyMorphTargets(const Document& document, const tinygltf::Primitive& primitive,
                               std::span<const double> weights, GeometryBudget* budget, Mesh* mesh);

/// Moves the vertices of `mesh` from the pose they were bound in into world space, each by the mean of its
/// joints' maps (at most eight). Returns how many vertices no joint moves: they stay where they are. Errors:
/// kInvalidArgument for missing attributes and joints that do not exist.
absl::StatusOr<int64_t> ApplySkin(const VertexSource& source, std::span<const Affine> world_from_bind,
                                  Mesh* mesh);

/// Error: a vertex was thrown out of floating-point range.
absl::Status CheckDeformed(const Mesh& mesh);

}  // namespace lumifold::scene
