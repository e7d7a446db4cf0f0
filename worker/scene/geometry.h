#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/deformers.h"
#include "worker/scene/document.h"
#include "worker/scene/vertex_source.h"

namespace lumifold::scene {

/// Converts glTF primitives to Meshes, within the limits of one load.
class GeometryReader {
 public:
  /// `document`, `materials` and `diagnostics` must outlive the reader.
  GeometryReader(const Document& document, const std::vector<Material>& materials, const LoadLimits& limits,
                 Diagnostics* diagnostics)
      : document_(document),
        materials_(materials),
        budget_{limits.max_triangles, limits.max_vertices},
        diagnostics_(diagnostics) {}

  /// A Mesh of separate triangles of `material`, deformed by `deformation`; nullopt if there are none to
  /// draw (points, lines, all degenerate). Strips and fans become triangles, unused vertices are removed,
  /// and tangents are generated if a normal texture needs them. Triangles whose normal cannot be computed
  /// in float are dropped and counted, and so are primitives of points and lines. Errors: kInvalidArgument
  /// starting with `place`; kResourceExhausted.
  absl::StatusOr<std::optional<Mesh>> Read(const tinygltf::Primitive& primitive, int material,
                                           const Deformation& deformation, const std::string& place);

 private:
  absl::StatusOr<Mesh> ReadVertices(const tinygltf::Primitive& primitive, int material,
                                    const Deformation& deformation, const std::string& place);
  void Clean(const std::string& place, Mesh* mesh);

  const Document& document_;
  const std::vector<Material>& materials_;
  GeometryBudget budget_;
  Diagnostics* diagnostics_;
};

}  // namespace lumifold::scene
