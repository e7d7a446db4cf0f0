#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"
#include "worker/scene/draco_mesh.h"

namespace lumifold::scene {

/// The remaining triangles and vertices of the load limits.
struct GeometryBudget {
  int64_t triangles = 0;
  int64_t vertices = 0;
};

/// The vertices and indices of one primitive, from accessors or compressed with Draco. Errors of all
/// functions: kInvalidArgument, kResourceExhausted, naming the attribute or accessor.
class VertexSource {
 public:
  /// Subtracts the primitive's size from `budget` before anything is allocated, because a few bytes of JSON
  /// can reference one accessor many times. The primitive must have positions and triangles. `document` and
  /// `primitive` must outlive the source.
  static absl::StatusOr<VertexSource> Open(const Document& document, const tinygltf::Primitive& primitive,
                                           GeometryBudget* budget);

  size_t vertex_count() const { return vertex_count_; }
  bool Has(const std::string& attribute) const { return primitive_->attributes.contains(attribute); }

  /// Reads attribute `attribute`, one element for each vertex; none if it is missing.
  absl::Status Read(const char* attribute, std::vector<Vec2>* out) const;
  absl::Status Read(const char* attribute, std::vector<Vec3>* out) const;
  absl::Status Read(const char* attribute, std::vector<Vec4>* out) const;
  absl::Status Read(const char* attribute, std::vector<std::array<uint32_t, 4>>* out) const;
  /// RGBA; alpha is 1 if the attribute is RGB.
  absl::Status ReadRgba(const char* attribute, std::vector<Vec4>* out) const;

  /// Indices in the order of the primitive's mode; all in range.
  absl::StatusOr<std::vector<uint32_t>> Corners() const;

 private:
  VertexSource(const Document& document, const tinygltf::Primitive& primitive)
      : document_(&document), primitive_(&primitive) {}

  absl::Status OpenAccessors(GeometryBudget* budget);
  absl::Status OpenDraco(const tinygltf::Value& extension, GeometryBudget* budget);

  /// The Draco attribute for glTF's `attribute`.
  std::optional<int> DracoAttribute(const char* attribute) const;

  /// Reads by `read(document, accessor)` or, if it is compressed, by `unpack(attribute)`.
  template <typename T, typename ReadAccessor, typename Unpack>
  absl::Status ReadWith(const char* attribute, ReadAccessor read, Unpack unpack, std::vector<T>* out) const;

  const Document* document_;
  const tinygltf::Primitive* primitive_;
  std::optional<DracoMesh> draco_;
  const tinygltf::Value* draco_attributes_ = nullptr;
  size_t vertex_count_ = 0;
};

/// The number of triangles that `corners` indices form in `mode`.
int64_t TriangleCount(int mode, size_t corners);

}  // namespace lumifold::scene
