#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// A glTF mesh (all its primitives) placed in the world. A skinned one has the identity: its joints place it.
struct Placement {
  int mesh = kNone;
  int node = kNone;
  Affine world_from_object;
  std::string name;
};

/// What the chosen scene's nodes hold, in the order of a walk from its roots.
struct NodeContents {
  std::vector<Placement> placements;
  std::vector<Camera> cameras;
  std::vector<PunctualLight> lights;
  std::vector<std::optional<Affine>> world_from_node;  // one a node of the document; empty: not in the scene
};

/// Walks the default scene (the first where none is named; all root nodes where there are no scenes). A
/// node's mesh with EXT_mesh_gpu_instancing is placed once an instance, a skinned one once. Placements,
/// cameras and lights that a transform flattens are left out and counted. Errors: kInvalidArgument for
/// cycles, nodes with two parents, indices out of range, malformed transforms, cameras and lights;
/// kResourceExhausted over `limits`; all name the node.
absl::StatusOr<NodeContents> WalkNodes(const Document& document, const LoadLimits& limits,
                                       Diagnostics* diagnostics);

}  // namespace lumifold::scene
