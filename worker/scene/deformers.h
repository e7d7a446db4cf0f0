#pragma once

#include <span>
#include <vector>

#include "absl/status/status.h"
#include "worker/scene/document.h"
#include "worker/scene/vertex_source.h"

namespace lumifold::scene {

/// The deformation of a mesh at one placement.
struct Deformation {
  std::span<const double> morph_weights;    // one for each morph target; empty: none applied
  std::span<const Affine> world_from_bind;  // one for each joint of the skin; empty: not skinned
};

/// Adds the weighted morph targets of `primitive` to positions, normals and tangents of `mesh`, which holds
/// all vertices of the primitive. Targets of weight 0 are not read; every other target subtracts its vertices
/// from `budget`. Errors: kInvalidArgument if the numbers of weights and targets differ or accessors do not
/// fit; kResourceExhausted.
absl::Status ApplyMorphTargets(const Document& document, const tinygltf::Primitive& primitive,
                               std::span<const double> weights, GeometryBudget* budget, Mesh* mesh);

/// Transforms the vertices of `mesh` from the bind pose to world space by linear blend skinning with at most
/// eight joints per vertex. Vertices without weights are unchanged; returns their number. Errors:
/// kInvalidArgument for missing attributes and joints that do not exist.
absl::StatusOr<int64_t> ApplySkin(const VertexSource& source, std::span<const Affine> world_from_bind,
                                  Mesh* mesh);

/// Error: a vertex is outside the floating-point range.
absl::Status CheckDeformed(const Mesh& mesh);

}  // namespace lumifold::scene
