#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace draco {
class Mesh;
}

namespace lumifold::scene {

/// A mesh compressed with Draco (bitstream 2.2, as KHR_draco_mesh_compression requires).
class DracoMesh {
 public:
  /// The size stated in the header, before decoding.
  struct Size {
    int64_t triangles = 0;
    int64_t max_vertices = 0;
  };

  /// Errors: kInvalidArgument if the bytes are not a Draco mesh of that version, or claim more triangles than
  /// so few bytes can hold.
  static absl::StatusOr<Size> PeekSize(std::string_view bytes);

  /// Memory in proportion to PeekSize. Errors: kInvalidArgument, kResourceExhausted.
  static absl::StatusOr<DracoMesh> Decode(std::string_view bytes);

  DracoMesh(DracoMesh&&) noexcept;
  DracoMesh& operator=(DracoMesh&&) noexcept;
  ~DracoMesh();

  size_t vertex_count() const;

  /// Vertex indices, three for each triangle.
  std::vector<uint32_t> Corners() const;

  /// The number of components of an attribute. Error: there is none with this id.
  absl::StatusOr<int> Width(int attribute) const;

  /// Attribute `attribute` (a unique id) of all vertices, `width` components each; integers are normalised if
  /// the attribute is. Errors: kInvalidArgument if it does not exist, has another width, or is not finite.
  absl::StatusOr<std::vector<float>> Floats(int attribute, int width) const;

  /// The same for unsigned integers.
  absl::StatusOr<std::vector<uint32_t>> Unsigned(int attribute, int width) const;

 private:
  explicit DracoMesh(std::unique_ptr<draco::Mesh> mesh);

  template <typename T>
  absl::StatusOr<std::vector<T>> Values(int attribute, int width) const;

  std::unique_ptr<draco::Mesh> mesh_;
};

}  // namespace lumifold::scene
