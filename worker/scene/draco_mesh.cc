#include "worker/scene/draco_mesh.h"

#include <cmath>
#include <optional>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "draco/compression/config/compression_shared.h"
#include "draco/compression/config/decoder_options.h"
#include "draco/compression/mesh/mesh_edgebreaker_decoder.h"
#include "draco/compression/mesh/mesh_sequential_decoder.h"
#include "draco/core/decoder_buffer.h"
#include "draco/core/varint_decoding.h"
#include "draco/mesh/mesh.h"

namespace lumifold::scene {
namespace {

// A good encoder needs some bits per triangle even for the simplest mesh. Data that claims more is a
// decompression bomb.
constexpr int64_t kMaxTrianglesPerByte = 256;

// glTF's attributes take 140 bytes per vertex with two sets of each. An attribute whose values are all equal
// costs the file no bytes, so their number must be bounded.
constexpr int64_t kMaxBytesPerVertex = 512;
constexpr int kMaxAttributeSeamSets = 16;

/// Whether glTF has accessors of this type and `T` can hold their values. A damaged file may claim any type,
/// and Draco converts without checks: bytes that are not a bool, and numbers that do not fit.
template <typename T>
bool IsReadable(draco::DataType type) {
  switch (type) {
    case draco::DT_UINT8:
    case draco::DT_UINT16:
    case draco::DT_UINT32:
      return true;
    case draco::DT_INT8:
    case draco::DT_INT16:
    case draco::DT_FLOAT32:
      return std::is_floating_point_v<T>;
    default:
      return false;
  }
}

absl::Status Damaged() { return absl::InvalidArgumentError("damaged or cut short"); }

/// Checks the sizes to be decoded before memory is allocated. `Base` is one of Draco's decoders.
template <typename Base>
class GuardedDecoder : public Base {
 public:
  bool too_wide() const { return too_wide_; }

 protected:
  bool DecodeAllAttributes() override {
    int64_t bytes = 0;
    for (int i = 0; i < this->point_cloud()->num_attributes(); ++i) {
      const draco::PointAttribute& attribute = *this->point_cloud()->attribute(i);
      bytes += int64_t{attribute.num_components()} * draco::DataTypeLength(attribute.data_type());
    }
    too_wide_ = bytes > kMaxBytesPerVertex;
    return !too_wide_ && Base::DecodeAllAttributes();
  }

 private:
  bool too_wide_ = false;
};

template <typename Base>
absl::Status DecodeWith(std::string_view bytes, draco::Mesh* mesh) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  const draco::DecoderOptions options;
  GuardedDecoder<Base> decoder;
  const draco::Status status = decoder.Decode(options, &buffer, mesh);
  if (decoder.too_wide()) {
    return absl::ResourceExhaustedError(
        absl::StrCat("attributes of more than ", kMaxBytesPerVertex, " bytes a vertex"));
  }
  return status.ok() ? absl::OkStatus() : Damaged();
}

/// The header and the counts that follow it (Draco's bitstream specification 2.2).
struct Head {
  uint8_t method = 0;
  uint32_t triangles = 0;
  uint32_t vertices = 0;  // sequential encoding only
  uint8_t seam_sets = 0;  // edgebreaker only
};

absl::StatusOr<Head> ReadHead(std::string_view bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::DracoHeader header;
  if (!draco::PointCloudDecoder::DecodeHeader(&buffer, &header).ok()) {
    return absl::InvalidArgumentError("not Draco data");
  }
  if (header.version_major != 2 || header.version_minor != 2) {
    return absl::InvalidArgumentError(absl::StrCat("Draco bitstream ", int{header.version_major}, ".",
                                                   int{header.version_minor}, ", only 2.2 is read"));
  }
  if (header.encoder_type != draco::TRIANGULAR_MESH) return absl::InvalidArgumentError("not a mesh");
  if ((header.flags & METADATA_FLAG_MASK) != 0) {
    return absl::InvalidArgumentError("Draco metadata is not supported");
  }
  Head head;
  head.method = header.encoder_method;
  buffer.set_bitstream_version(DRACO_BITSTREAM_VERSION(2, 2));
  if (head.method == draco::MESH_SEQUENTIAL_ENCODING) {
    if (draco::DecodeVarint(&head.triangles, &buffer) && draco::DecodeVarint(&head.vertices, &buffer)) {
      return head;
    }
    return Damaged();
  }
  if (head.method != draco::MESH_EDGEBREAKER_ENCODING) return absl::InvalidArgumentError("unknown encoding");
  uint8_t traversal = 0;
  uint32_t connectivity_vertices = 0;
  const bool whole = buffer.Decode(&traversal) && draco::DecodeVarint(&connectivity_vertices, &buffer) &&
                     draco::DecodeVarint(&head.triangles, &buffer) && buffer.Decode(&head.seam_sets);
  if (!whole) return Damaged();
  return head;
}

}  // namespace

absl::StatusOr<DracoMesh::Size> DracoMesh::PeekSize(std::string_view bytes) {
  const auto head = ReadHead(bytes);
  if (!head.ok()) return head.status();
  const Size size{head->triangles, std::max(int64_t{head->vertices}, int64_t{head->triangles} * 3)};
  const int64_t most = static_cast<int64_t>(bytes.size()) * kMaxTrianglesPerByte;
  if (size.triangles > most || int64_t{head->vertices} > most * 3) {
    return absl::InvalidArgumentError(
        absl::StrCat("claims ", size.triangles, " triangles, but has only ", bytes.size(), " bytes"));
  }
  if (head->seam_sets > kMaxAttributeSeamSets) {
    return absl::ResourceExhaustedError(absl::StrCat("more than ", kMaxAttributeSeamSets, " sets of seams"));
  }
  return size;
}

absl::StatusOr<DracoMesh> DracoMesh::Decode(std::string_view bytes) {
  if (const auto size = PeekSize(bytes); !size.ok()) return size.status();
  const auto head = ReadHead(bytes);
  if (!head.ok()) return head.status();
  auto mesh = std::make_unique<draco::Mesh>();
  auto s = head->method == draco::MESH_SEQUENTIAL_ENCODING
               ? DecodeWith<draco::MeshSequentialDecoder>(bytes, mesh.get())
               : DecodeWith<draco::MeshEdgebreakerDecoder>(bytes, mesh.get());
  if (!s.ok()) return s;
  for (draco::FaceIndex f(0); f < mesh->num_faces(); ++f) {
    for (const draco::PointIndex& corner : mesh->face(f)) {
      if (corner.value() >= mesh->num_points()) return Damaged();
    }
  }
  return DracoMesh(std::move(mesh));
}

DracoMesh::DracoMesh(std::unique_ptr<draco::Mesh> mesh) : mesh_(std::move(mesh)) {}
DracoMesh::DracoMesh(DracoMesh&&) noexcept = default;
DracoMesh& DracoMesh::operator=(DracoMesh&&) noexcept = default;
DracoMesh::~DracoMesh() = default;

size_t DracoMesh::vertex_count() const { return mesh_->num_points(); }

std::vector<uint32_t> DracoMesh::Corners() const {
  std::vector<uint32_t> corners;
  corners.reserve(size_t{mesh_->num_faces()} * 3);
  for (draco::FaceIndex f(0); f < mesh_->num_faces(); ++f) {
    for (const draco::PointIndex& corner : mesh_->face(f)) corners.push_back(corner.value());
  }
  return corners;
}

absl::StatusOr<int> DracoMesh::Width(int attribute) const {
  const draco::PointAttribute* found =
      attribute < 0 ? nullptr : mesh_->GetAttributeByUniqueId(static_cast<uint32_t>(attribute));
  if (found == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat("Draco attribute ", attribute, " does not exist"));
  }
  return int{found->num_components()};
}

template <typename T>
absl::StatusOr<std::vector<T>> DracoMesh::Values(int attribute, int width) const {
  const auto actual = Width(attribute);
  if (!actual.ok()) return actual.status();
  if (*actual != width) {
    return absl::InvalidArgumentError(
        absl::StrCat("Draco attribute ", attribute, " has ", *actual, " components, not ", width));
  }
  const draco::PointAttribute& source = *mesh_->GetAttributeByUniqueId(static_cast<uint32_t>(attribute));
  if (!IsReadable<T>(source.data_type())) {
    return absl::InvalidArgumentError(
        absl::StrCat("Draco attribute ", attribute, " is of a type that glTF does not have there"));
  }
  std::vector<T> values(vertex_count() * static_cast<size_t>(width));
  for (draco::PointIndex p(0); p < mesh_->num_points(); ++p) {
    const draco::AttributeValueIndex index = source.mapped_index(p);
    T* out = &values[size_t{p.value()} * static_cast<size_t>(width)];
    if (index.value() >= source.size() || !source.ConvertValue<T>(index, static_cast<int8_t>(width), out)) {
      return absl::InvalidArgumentError(absl::StrCat("Draco attribute ", attribute, " is damaged"));
    }
  }
  if constexpr (std::is_floating_point_v<T>) {
    for (const T value : values) {
      if (!std::isfinite(value)) {
        return absl::InvalidArgumentError(absl::StrCat("Draco attribute ", attribute, " is not finite"));
      }
    }
  }
  return values;
}

absl::StatusOr<std::vector<float>> DracoMesh::Floats(int attribute, int width) const {
  return Values<float>(attribute, width);
}

absl::StatusOr<std::vector<uint32_t>> DracoMesh::Unsigned(int attribute, int width) const {
  return Values<uint32_t>(attribute, width);
}

}  // namespace lumifold::scene
