#include "worker/scene/vertex_source.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/accessors.h"
#include "worker/scene/fields.h"

namespace lumifold::scene {
namespace {

constexpr char kDraco[] = "KHR_draco_mesh_compression";

absl::Status Spend(int64_t triangles, int64_t vertices, GeometryBudget* budget) {
  if (triangles > budget->triangles) {
    return absl::ResourceExhaustedError("more triangles than the limit allows");
  }
  if (vertices > budget->vertices) return absl::ResourceExhaustedError("more vertices than the limit allows");
  budget->triangles -= triangles;
  budget->vertices -= vertices;
  return absl::OkStatus();
}

/// Groups numbers into elements of T, as many numbers as T has components.
template <typename T, typename Number>
std::vector<T> Grouped(const std::vector<Number>& flat) {
  static_assert(sizeof(T) % sizeof(Number) == 0);
  constexpr size_t kWidth = sizeof(T) / sizeof(Number);
  std::vector<T> grouped(flat.size() / kWidth);
  auto* numbers = reinterpret_cast<Number*>(grouped.data());
  std::copy_n(flat.begin(), grouped.size() * kWidth, numbers);
  return grouped;
}

template <typename T>
absl::StatusOr<std::vector<T>> Unpacked(const DracoMesh& mesh, int attribute) {
  const auto flat = mesh.Floats(attribute, sizeof(T) / sizeof(float));
  if (!flat.ok()) return flat.status();
  return Grouped<T>(*flat);
}

absl::StatusOr<std::vector<Vec4>> UnpackedRgba(const DracoMesh& mesh, int attribute) {
  const auto width = mesh.Width(attribute);
  if (!width.ok() || *width != 3) return Unpacked<Vec4>(mesh, attribute);
  const auto rgb = Unpacked<Vec3>(mesh, attribute);
  if (!rgb.ok()) return rgb.status();
  return OpaqueColors(*rgb);
}

}  // namespace

int64_t TriangleCount(int mode, size_t corners) {
  const auto n = static_cast<int64_t>(corners);
  return mode == TINYGLTF_MODE_TRIANGLES ? n / 3 : std::max<int64_t>(n - 2, 0);
}

absl::StatusOr<VertexSource> VertexSource::Open(const Document& document,
                                                const tinygltf::Primitive& primitive,
                                                GeometryBudget* budget) {
  VertexSource source(document, primitive);
  const tinygltf::Value* compressed = FindExtension(primitive.extensions, kDraco);
  if (compressed == nullptr) {
    if (auto s = source.OpenAccessors(budget); !s.ok()) return s;
  } else if (auto s = source.OpenDraco(*compressed, budget); !s.ok()) {
    return WithContext(s, kDraco);
  }
  return source;
}

absl::Status VertexSource::OpenAccessors(GeometryBudget* budget) {
  const auto vertices = ElementCount(*document_, primitive_->attributes.at("POSITION"));
  if (!vertices.ok()) return vertices.status();
  if (*vertices >= std::numeric_limits<uint32_t>::max()) {
    return absl::ResourceExhaustedError(absl::StrCat(*vertices, " vertices in one primitive"));
  }
  const auto corners =
      primitive_->indices == kNone ? vertices : ElementCount(*document_, primitive_->indices);
  if (!corners.ok()) return corners.status();
  vertex_count_ = *vertices;
  return Spend(TriangleCount(primitive_->mode, *corners), static_cast<int64_t>(*vertices), budget);
}

absl::Status VertexSource::OpenDraco(const tinygltf::Value& extension, GeometryBudget* budget) {
  if (!extension.Has("bufferView") || !extension.Get("bufferView").IsInt() || !extension.Has("attributes") ||
      !extension.Get("attributes").IsObject()) {
    return absl::InvalidArgumentError("needs a bufferView and attributes");
  }
  if (primitive_->mode != TINYGLTF_MODE_TRIANGLES) {
    return absl::InvalidArgumentError("compressed strips are not supported");
  }
  draco_attributes_ = &extension.Get("attributes");
  const auto bytes = ViewBytes(*document_, extension.Get("bufferView").Get<int>());
  if (!bytes.ok()) return bytes.status();
  const auto size = DracoMesh::PeekSize(*bytes);
  if (!size.ok()) return size.status();
  if (auto s = Spend(size->triangles, size->max_vertices, budget); !s.ok()) return s;
  auto mesh = DracoMesh::Decode(*bytes);
  if (!mesh.ok()) return mesh.status();
  draco_ = *std::move(mesh);
  vertex_count_ = draco_->vertex_count();
  return absl::OkStatus();
}

std::optional<int> VertexSource::DracoAttribute(const char* attribute) const {
  if (draco_attributes_ == nullptr || !draco_attributes_->Has(attribute)) return std::nullopt;
  const tinygltf::Value& id = draco_attributes_->Get(attribute);
  return id.IsInt() ? id.Get<int>() : kNone;
}

template <typename T, typename ReadAccessor, typename Unpack>
absl::Status VertexSource::ReadWith(const char* attribute, ReadAccessor read, Unpack unpack,
                                    std::vector<T>* out) const {
  const auto accessor = primitive_->attributes.find(attribute);
  if (accessor == primitive_->attributes.end()) return absl::OkStatus();
  absl::StatusOr<std::vector<T>> values;
  if (const auto compressed = DracoAttribute(attribute); compressed.has_value()) {
    values = unpack(*draco_, *compressed);
  } else {
    const auto count = ElementCount(*document_, accessor->second);
    if (!count.ok()) return WithContext(count.status(), attribute);
    if (*count != vertex_count_) {
      return absl::InvalidArgumentError(
          absl::StrCat(attribute, ": ", *count, " elements for ", vertex_count_, " vertices"));
    }
    values = read(*document_, accessor->second);
  }
  if (!values.ok()) return WithContext(values.status(), attribute);
  *out = *std::move(values);
  return absl::OkStatus();
}

absl::Status VertexSource::Read(const char* attribute, std::vector<Vec2>* out) const {
  return ReadWith(attribute, ReadVec2s, Unpacked<Vec2>, out);
}

absl::Status VertexSource::Read(const char* attribute, std::vector<Vec3>* out) const {
  return ReadWith(attribute, ReadVec3s, Unpacked<Vec3>, out);
}

absl::Status VertexSource::Read(const char* attribute, std::vector<Vec4>* out) const {
  return ReadWith(attribute, ReadVec4s, Unpacked<Vec4>, out);
}

absl::Status VertexSource::ReadRgba(const char* attribute, std::vector<Vec4>* out) const {
  return ReadWith(attribute, ReadColors, UnpackedRgba, out);
}

absl::Status VertexSource::Read(const char* attribute, std::vector<std::array<uint32_t, 4>>* out) const {
  using Joints = std::array<uint32_t, 4>;
  const auto unpack = [](const DracoMesh& mesh, int id) -> absl::StatusOr<std::vector<Joints>> {
    const auto flat = mesh.Unsigned(id, 4);
    if (!flat.ok()) return flat.status();
    return Grouped<Joints>(*flat);
  };
  return ReadWith(attribute, ReadJoints, unpack, out);
}

absl::StatusOr<std::vector<uint32_t>> VertexSource::Corners() const {
  if (draco_.has_value()) return draco_->Corners();
  if (primitive_->indices == kNone) {
    std::vector<uint32_t> corners(vertex_count_);
    std::iota(corners.begin(), corners.end(), 0u);
    return corners;
  }
  auto corners = ReadIndices(*document_, primitive_->indices);
  if (!corners.ok()) return corners.status();
  for (size_t i = 0; i < corners->size(); ++i) {
    if ((*corners)[i] >= vertex_count_) {
      return absl::InvalidArgumentError(absl::StrCat("index ", (*corners)[i], " at position ", i,
                                                     " is out of range (", vertex_count_, " vertices)"));
    }
  }
  return corners;
}

}  // namespace lumifold::scene
