#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"
#include "worker/scene/transforms.h"

namespace lumifold::scene {

/// A glTF mesh (all its primitives) placed in the world. A skinned mesh has the identity; its joints place
/// it.
struct Placement {
  int mesh = kNone;
  int node = kNone;
  Affine world_from_object;
  std::string name;
};

/// Contents of the scene's nodes, in depth-first order from its roots.
struct NodeContents {
  Point64 origin = {};  // of Scene: subtracted from all places below
  std::vector<Placement> placements;
  std::vector<Camera> cameras;
  std::vector<PunctualLight> lights;
  std::vector<std::optional<Affine>> world_from_node;  // by node of the document; nullopt: not in the scene
};

/// Traverses the default scene (the first one if none is named; all root nodes if there are no scenes). A
/// mesh with EXT_mesh_gpu_instancing is placed once for each instance, a skinned mesh once. Placements,
/// cameras and lights whose transform is singular are left out and counted. Errors: kInvalidArgument for
/// cycles, nodes with two parents, indices out of range, malformed transforms, cameras and lights;
/// kResourceExhausted over `limits`; all name the node.
absl::StatusOr<NodeContents> WalkNodes(const Document& document, const LoadLimits& limits,
                                       Diagnostics* diagnostics);

}  // namespace lumifold::scene
