#include "worker/scene/geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/scene/directions.h"
#include "worker/scene/tangents.h"

namespace lumifold::scene {
namespace {

using Triangles = std::vector<uint32_t>;

constexpr uint32_t kUnused = std::numeric_limits<uint32_t>::max();

bool DrawsTriangles(int mode) {
  return mode == TINYGLTF_MODE_TRIANGLES || mode == TINYGLTF_MODE_TRIANGLE_STRIP ||
         mode == TINYGLTF_MODE_TRIANGLE_FAN;
}

/// Separate triangles from a list, strip or fan of vertex indices, with the winding of glTF 2.0 (3.7.2.1).
Triangles Separate(int mode, Triangles corners) {
  const auto count = static_cast<size_t>(TriangleCount(mode, corners.size()));
  if (mode == TINYGLTF_MODE_TRIANGLES) {
    corners.resize(3 * count);
    return corners;
  }
  Triangles triangles;
  triangles.reserve(3 * count);
  for (size_t i = 0; i < count; ++i) {
    if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) {
      triangles.insert(triangles.end(), {corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]});
    } else {
      triangles.insert(triangles.end(), {corners[i + 1], corners[i + 2], corners[0]});
    }
  }
  return triangles;
}

/// Twice the area times the normal.
Vec3 FaceVector(const Mesh& mesh, const uint32_t* corners) {
  const Vec3 origin = mesh.positions[corners[0]];
  return Cross(mesh.positions[corners[1]] - origin, mesh.positions[corners[2]] - origin);
}

/// Removes triangles whose normal cannot be computed in float: equal or collinear vertices, extents beyond
/// 1e9 or below 1e-9. Returns their number.
int64_t DropDegenerate(Mesh* mesh) {
  size_t kept = 0;
  Triangles& t = mesh->triangles;
  for (size_t i = 0; i < t.size(); i += 3) {
    if (!std::isnormal(LengthSquared(FaceVector(*mesh, &t[i])))) continue;
    for (size_t c = 0; c < 3; ++c) t[kept++] = t[i + c];
  }
  const size_t dropped = (t.size() - kept) / 3;
  t.resize(kept);
  return static_cast<int64_t>(dropped);
}

template <typename Vec>
void Gather(const std::vector<uint32_t>& new_from_old, size_t used, std::vector<Vec>* values) {
  if (values->empty()) return;
  std::vector<Vec> gathered(used);
  for (size_t old = 0; old < new_from_old.size(); ++old) {
    if (new_from_old[old] != kUnused) gathered[new_from_old[old]] = (*values)[old];
  }
  *values = std::move(gathered);
}

/// Removes vertices that no triangle uses: exporters often share one large vertex array among primitives.
void DropUnusedVertices(Mesh* mesh) {
  std::vector<uint32_t> new_from_old(mesh->positions.size(), kUnused);
  for (const uint32_t corner : mesh->triangles) new_from_old[corner] = 0;
  uint32_t used = 0;
  for (uint32_t& index : new_from_old) {
    if (index != kUnused) index = used++;
  }
  if (used == mesh->positions.size()) return;
  for (uint32_t& corner : mesh->triangles) corner = new_from_old[corner];
  Gather(new_from_old, used, &mesh->positions);
  Gather(new_from_old, used, &mesh->normals);
  Gather(new_from_old, used, &mesh->uvs[0]);
  Gather(new_from_old, used, &mesh->uvs[1]);
  Gather(new_from_old, used, &mesh->tangents);
  Gather(new_from_old, used, &mesh->colors);
}

/// Normalises the normals. A normal of length zero becomes the mean of the adjacent faces. Returns the number
/// of those.
int64_t NormalizeNormals(Mesh* mesh) {
  if (mesh->normals.empty()) return 0;
  std::vector<bool> is_zero(mesh->normals.size());
  int64_t zeros = 0;
  for (size_t i = 0; i < is_zero.size(); ++i) {
    const auto unit = UnitVector(mesh->normals[i]);
    is_zero[i] = !unit.has_value();
    zeros += is_zero[i] ? 1 : 0;
    mesh->normals[i] = unit.value_or(Vec3{0, 0, 0});
  }
  if (zeros == 0) return 0;
  for (size_t i = 0; i < mesh->triangles.size(); i += 3) {
    const Vec3 face = Normalize(FaceVector(*mesh, &mesh->triangles[i]));
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t corner = mesh->triangles[i + c];
      if (is_zero[corner]) mesh->normals[corner] += face;
    }
  }
  for (size_t i = 0; i < is_zero.size(); ++i) {
    if (is_zero[i]) mesh->normals[i] = UnitVector(mesh->normals[i]).value_or(Vec3{0, 0, 1});
  }
  return zeros;
}

void NormalizeTangents(Mesh* mesh) {
  for (size_t i = 0; i < mesh->tangents.size(); ++i) {
    Vec4& t = mesh->tangents[i];
    const Vec3 unit = UnitVector({t.x, t.y, t.z}).value_or(Perpendicular(mesh->normals[i]));
    t = {unit.x, unit.y, unit.z, t.w < 0 ? -1.0f : 1.0f};
  }
}

/// Clamps vertex colours to 0 to 1: they multiply the base colour, which must conserve energy. Returns the
/// number of clamped ones.
int64_t ClampColors(Mesh* mesh) {
  int64_t clamped = 0;
  for (Vec4& color : mesh->colors) {
    const Vec4 raw = color;
    const auto fraction = [](float value) { return std::clamp(value, 0.0f, 1.0f); };
    color = {fraction(raw.x), fraction(raw.y), fraction(raw.z), fraction(raw.w)};
    clamped += color.x != raw.x || color.y != raw.y || color.z != raw.z || color.w != raw.w ? 1 : 0;
  }
  return clamped;
}

absl::Status ReadAttributes(const VertexSource& source, Mesh* mesh) {
  auto s = source.Read("POSITION", &mesh->positions);
  if (s.ok()) s = source.Read("NORMAL", &mesh->normals);
  if (s.ok()) s = source.Read("TEXCOORD_0", &mesh->uvs[0]);
  if (s.ok()) s = source.Read("TEXCOORD_1", &mesh->uvs[1]);
  if (s.ok()) s = source.ReadRgba("COLOR_0", &mesh->colors);
  // glTF: the file's tangents are ignored for flat normals.
  if (s.ok() && !mesh->normals.empty()) s = source.Read("TANGENT", &mesh->tangents);
  return s;
}

bool NeedsTangents(const Material& material) {
  return material.normal_map.texture.texture != kNone ||
         material.clearcoat.normal_map.texture.texture != kNone || material.base.anisotropy.strength > 0;
}

/// From whose texture coordinates tangents are generated: those of the first texture that needs them. A coat
/// over a base with a normal map uses the base's tangents.
const TextureRef& MapOfTangents(const Material& material) {
  for (const TextureRef* map : {&material.normal_map.texture, &material.base.anisotropy.texture,
                                &material.clearcoat.normal_map.texture}) {
    if (map->texture != kNone) return *map;
  }
  return material.normal_map.texture;  // names no texture: the first texture coordinates as they are
}

}  // namespace

absl::StatusOr<Mesh> GeometryReader::ReadVertices(const tinygltf::Primitive& primitive, int material,
                                                  const Deformation& deformation, const std::string& place) {
  const auto source = VertexSource::Open(document_, primitive, &budget_);
  if (!source.ok()) return source.status();
  Mesh mesh;
  mesh.material = material;
  // First the attributes: corners that are not stored are made for as many vertices as the file claims to
  // have.
  if (auto s = ReadAttributes(*source, &mesh); !s.ok()) return s;
  auto corners = source->Corners();
  if (!corners.ok()) return corners.status();
  mesh.triangles = Separate(primitive.mode, *std::move(corners));
  auto s = ApplyMorphTargets(document_, primitive, deformation.morph_weights, &budget_, &mesh);
  if (!s.ok()) return s;
  if (!deformation.world_from_bind.empty()) {
    const auto unmoved = ApplySkin(*source, deformation.world_from_bind, &mesh);
    if (!unmoved.ok()) return unmoved.status();
    diagnostics_->Count("vertices of skinned meshes that no joint moves", place, *unmoved);
  }
  if (s = CheckDeformed(mesh); !s.ok()) return s;
  return mesh;
}

void GeometryReader::Clean(const std::string& place, Mesh* mesh) {
  DropUnusedVertices(mesh);
  mesh->positions.reserve(mesh->positions.size() + 1);
  diagnostics_->Count("normals of length zero replaced", place, NormalizeNormals(mesh));
  NormalizeTangents(mesh);
  diagnostics_->Count("vertex colours outside 0 to 1 clamped", place, ClampColors(mesh));
  if (mesh->material == kNone || !mesh->tangents.empty()) return;
  const Material& material = materials_[mesh->material];
  if (NeedsTangents(material)) GenerateTangents(MapOfTangents(material), mesh);
  if (material.base.anisotropy.strength > 0 && mesh->tangents.empty())
    diagnostics_->Count("meshes without tangents and texture coordinates have round highlights", place);
}

absl::StatusOr<std::optional<Mesh>> GeometryReader::Read(const tinygltf::Primitive& primitive, int material,
                                                         const Deformation& deformation,
                                                         const std::string& place) {
  if (primitive.mode < TINYGLTF_MODE_POINTS || primitive.mode > TINYGLTF_MODE_TRIANGLE_FAN) {
    return absl::InvalidArgumentError(absl::StrCat(place, ": mode ", primitive.mode, " is not glTF's"));
  }
  if (!DrawsTriangles(primitive.mode)) {
    diagnostics_->Count("primitives of points or lines left out", place);
    return std::nullopt;
  }
  if (!primitive.attributes.contains("POSITION")) {
    diagnostics_->Count("primitives without positions left out", place);
    return std::nullopt;
  }
  auto mesh = ReadVertices(primitive, material, deformation, place);
  if (!mesh.ok()) return WithContext(mesh.status(), place);
  diagnostics_->Count("triangles without area dropped", place, DropDegenerate(&*mesh));
  if (mesh->triangles.empty()) return std::nullopt;
  Clean(place, &*mesh);
  return *std::move(mesh);
}

}  // namespace lumifold::scene
