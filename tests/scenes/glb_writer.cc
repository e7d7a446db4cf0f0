#include "tests/scenes/glb_writer.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "tests/scenes/png_writer.h"

namespace lumifold::scenes {
namespace {

using Json = nlohmann::json;

// glTF 2.0 constants (the specification, sections 3.6.2 and 5.11).
constexpr int kFloat = 5126;
constexpr int kUnsignedShort = 5123;
constexpr int kUnsignedInt = 5125;
constexpr int kArrayBuffer = 34962;
constexpr int kElementArrayBuffer = 34963;
constexpr std::uint32_t kGlbMagic = 0x46546C67;
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;
constexpr std::uint32_t kBinaryChunk = 0x004E4942;

// Powers of two, so that a rounded value is exact in float32.
constexpr double kPositionGrid = 1.0 / (1 << 14);  // 0.06 mm
constexpr double kUnitGrid = 1.0 / (1 << 18);      // normals, rotations, texture coordinates

double RoundTo(double grid, double value) {
  const double rounded = std::floor(value / grid + 0.5) * grid;
  return rounded == 0 ? 0 : rounded;  // no negative zero
}

Json JsonVec3(Vec3 v, double grid) { return {RoundTo(grid, v.x), RoundTo(grid, v.y), RoundTo(grid, v.z)}; }

void AppendLittleEndian(std::string& out, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) out.push_back(static_cast<char>(value >> (8 * i) & 0xff));
}

void AppendFloat(std::string& out, double value) {
  const float narrow = static_cast<float>(value);
  std::uint32_t bits = 0;
  std::memcpy(&bits, &narrow, sizeof(bits));
  AppendLittleEndian(out, bits, 4);
}

/// Collects the binary chunk and the JSON that describes it.
class GlbBuilder {
 public:
  absl::Status AddTextures(std::span<const Texture> textures);
  absl::Status AddMaterials(const SceneDescription& scene);
  absl::Status AddMeshes(const SceneDescription& scene);
  absl::Status AddNodes(const SceneDescription& scene);
  std::string Finish() &&;

 private:
  int AddView(std::string_view bytes, int target);
  int AddAccessor(Json accessor, std::string_view bytes, int target);
  int AddPositions(std::span<const Vec3> positions);
  int AddNormals(std::span<const Vec3> normals);
  int AddUvs(std::span<const Vec2> uvs, Vec2 texture_size_m);
  int AddIndices(const Mesh& mesh);

  Json root_ = {{"asset", {{"version", "2.0"}, {"generator", "lumifold-scenes"}}}};
  std::string binary_;
};

int GlbBuilder::AddView(std::string_view bytes, int target) {
  Json view = {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes.size()}};
  if (target != 0) view["target"] = target;
  binary_.append(bytes);
  binary_.resize((binary_.size() + 3) / 4 * 4, '\0');
  root_["bufferViews"].push_back(std::move(view));
  return static_cast<int>(root_["bufferViews"].size()) - 1;
}

int GlbBuilder::AddAccessor(Json accessor, std::string_view bytes, int target) {
  accessor["bufferView"] = AddView(bytes, target);
  root_["accessors"].push_back(std::move(accessor));
  return static_cast<int>(root_["accessors"].size()) - 1;
}

int GlbBuilder::AddPositions(std::span<const Vec3> positions) {
  std::string bytes;
  Vec3 low = positions.front();
  Vec3 high = low;
  for (const Vec3& p : positions) {
    for (const double value : {p.x, p.y, p.z}) AppendFloat(bytes, RoundTo(kPositionGrid, value));
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  return AddAccessor({{"componentType", kFloat},
                      {"type", "VEC3"},
                      {"count", positions.size()},
                      {"min", JsonVec3(low, kPositionGrid)},
                      {"max", JsonVec3(high, kPositionGrid)}},
                     bytes, kArrayBuffer);
}

int GlbBuilder::AddNormals(std::span<const Vec3> normals) {
  std::string bytes;
  for (const Vec3& n : normals) {
    for (const double value : {n.x, n.y, n.z}) AppendFloat(bytes, RoundTo(kUnitGrid, value));
  }
  return AddAccessor({{"componentType", kFloat}, {"type", "VEC3"}, {"count", normals.size()}}, bytes,
                     kArrayBuffer);
}

int GlbBuilder::AddUvs(std::span<const Vec2> uvs, Vec2 texture_size_m) {
  std::string bytes;
  for (const Vec2& uv : uvs) {
    AppendFloat(bytes, RoundTo(kUnitGrid, uv.x / texture_size_m.x));
    // v points up from the bottom of the picture here, in glTF down from its top.
    AppendFloat(bytes, RoundTo(kUnitGrid, 1 - uv.y / texture_size_m.y));
  }
  return AddAccessor({{"componentType", kFloat}, {"type", "VEC2"}, {"count", uvs.size()}}, bytes,
                     kArrayBuffer);
}

int GlbBuilder::AddIndices(const Mesh& mesh) {
  const bool wide = mesh.positions.size() > 65535;
  std::string bytes;
  for (const std::uint32_t index : mesh.indices) AppendLittleEndian(bytes, index, wide ? 4 : 2);
  return AddAccessor({{"componentType", wide ? kUnsignedInt : kUnsignedShort},
                      {"type", "SCALAR"},
                      {"count", mesh.indices.size()}},
                     bytes, kElementArrayBuffer);
}

absl::Status GlbBuilder::AddTextures(std::span<const Texture> textures) {
  for (const Texture& texture : textures) {
    const absl::StatusOr<std::string> png = EncodePng(texture);
    if (!png.ok()) return png.status();
    root_["images"].push_back(
        {{"name", texture.name}, {"mimeType", "image/png"}, {"bufferView", AddView(*png, 0)}});
    root_["textures"].push_back({{"source", root_["images"].size() - 1}});
  }
  return absl::OkStatus();
}

Json MaterialJson(const Material& material) {
  Json base_color = JsonVec3(material.base_color, kUnitGrid);
  base_color.push_back(1.0);
  Json pbr = {{"baseColorFactor", base_color},
              {"metallicFactor", RoundTo(kUnitGrid, material.metallic)},
              {"roughnessFactor", RoundTo(kUnitGrid, material.roughness)}};
  if (material.texture) pbr["baseColorTexture"] = {{"index", static_cast<int>(*material.texture)}};
  Json json = {{"name", material.name}, {"pbrMetallicRoughness", pbr}};
  if (material.double_sided) json["doubleSided"] = true;
  if (material.unlit) json["extensions"]["KHR_materials_unlit"] = Json::object();
  if (material.specular != 1) {
    json["extensions"]["KHR_materials_specular"]["specularFactor"] = RoundTo(kUnitGrid, material.specular);
  }
  if (material.transmission > 0) {
    json["extensions"]["KHR_materials_transmission"]["transmissionFactor"] =
        RoundTo(kUnitGrid, material.transmission);
  }
  // Readers derive the path inside from the mesh; they need a thickness above 0 only to know that it is a
  // solid.
  if (material.is_solid) json["extensions"]["KHR_materials_volume"]["thicknessFactor"] = 1;
  const double strength = std::max({material.emission.x, material.emission.y, material.emission.z});
  if (strength > 0) {
    json["emissiveFactor"] = JsonVec3(material.emission * (1 / strength), kUnitGrid);
    json["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = RoundTo(kUnitGrid, strength);
  }
  return json;
}

absl::Status GlbBuilder::AddMaterials(const SceneDescription& scene) {
  for (const Material& material : scene.materials) {
    if (material.texture && static_cast<std::size_t>(*material.texture) >= scene.textures.size()) {
      return absl::InvalidArgumentError(absl::StrCat("material ", material.name, ": no such texture"));
    }
    Json json = MaterialJson(material);
    if (json.contains("extensions")) {
      for (const auto& [name, value] : json["extensions"].items()) {
        Json& used = root_["extensionsUsed"];
        if (std::find(used.begin(), used.end(), name) == used.end()) used.push_back(name);
      }
    }
    root_["materials"].push_back(std::move(json));
  }
  return absl::OkStatus();
}

absl::Status CheckMesh(const std::string& name, const Mesh& mesh) {
  const std::size_t vertices = mesh.positions.size();
  if (vertices == 0 || mesh.normals.size() != vertices || mesh.uvs.size() != vertices) {
    return absl::InvalidArgumentError(
        absl::StrCat("mesh ", name, ": vertex arrays empty or of unlike length"));
  }
  if (mesh.indices.empty() || mesh.indices.size() % 3 != 0) {
    return absl::InvalidArgumentError(absl::StrCat("mesh ", name, ": ", mesh.indices.size(), " indices"));
  }
  if (*std::max_element(mesh.indices.begin(), mesh.indices.end()) >= vertices) {
    return absl::InvalidArgumentError(absl::StrCat("mesh ", name, ": an index beyond vertex ", vertices - 1));
  }
  return absl::OkStatus();
}

absl::Status GlbBuilder::AddMeshes(const SceneDescription& scene) {
  for (const NamedMesh& mesh : scene.meshes) {
    Json primitives = Json::array();
    for (const Primitive& primitive : mesh.primitives) {
      if (absl::Status status = CheckMesh(mesh.name, primitive.mesh); !status.ok()) return status;
      const std::size_t material_index = static_cast<std::size_t>(primitive.material);
      if (material_index >= scene.materials.size()) {
        return absl::InvalidArgumentError(absl::StrCat("mesh ", mesh.name, ": no such material"));
      }
      const Material& material = scene.materials[material_index];
      Json attributes = {{"POSITION", AddPositions(primitive.mesh.positions)},
                         {"NORMAL", AddNormals(primitive.mesh.normals)}};
      if (material.texture) attributes["TEXCOORD_0"] = AddUvs(primitive.mesh.uvs, material.texture_size_m);
      primitives.push_back({{"attributes", attributes},
                            {"indices", AddIndices(primitive.mesh)},
                            {"material", material_index}});
    }
    root_["meshes"].push_back({{"name", mesh.name}, {"primitives", primitives}});
  }
  return absl::OkStatus();
}

Json NodeJson(const std::string& name, const Transform& transform) {
  const Rotation& r = transform.rotation;
  Json json = {{"name", name}};
  if (transform.translation != Vec3{}) json["translation"] = JsonVec3(transform.translation, kPositionGrid);
  if (r.w != 1) {
    json["rotation"] = {RoundTo(kUnitGrid, r.x), RoundTo(kUnitGrid, r.y), RoundTo(kUnitGrid, r.z),
                        RoundTo(kUnitGrid, r.w)};
  }
  if (transform.scale != Vec3{1, 1, 1}) json["scale"] = JsonVec3(transform.scale, kUnitGrid);
  return json;
}

absl::Status GlbBuilder::AddNodes(const SceneDescription& scene) {
  Json roots = Json::array();
  for (const Node& node : scene.nodes) {
    if (static_cast<std::size_t>(node.mesh) >= scene.meshes.size()) {
      return absl::InvalidArgumentError(absl::StrCat("node ", node.name, ": no such mesh"));
    }
    Json json = NodeJson(node.name, node.transform);
    json["mesh"] = static_cast<int>(node.mesh);
    roots.push_back(root_["nodes"].size());
    root_["nodes"].push_back(std::move(json));
  }
  const double yfov = RoundTo(kUnitGrid, Radians(scene.camera.vertical_fov_degrees));
  const Json perspective = {{"yfov", yfov}, {"aspectRatio", 4.0 / 3.0}, {"znear", 0.01}};
  root_["cameras"].push_back({{"name", "camera"}, {"type", "perspective"}, {"perspective", perspective}});
  Json json = NodeJson("camera", scene.camera.transform);
  json["camera"] = 0;
  roots.push_back(root_["nodes"].size());
  root_["nodes"].push_back(std::move(json));
  root_["scenes"].push_back({{"name", scene.name}, {"nodes", roots}});
  root_["scene"] = 0;
  return absl::OkStatus();
}

std::string GlbBuilder::Finish() && {
  root_["buffers"].push_back({{"byteLength", binary_.size()}});
  std::string json = root_.dump();
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string file;
  const std::size_t total = 12 + 8 + json.size() + 8 + binary_.size();
  AppendLittleEndian(file, kGlbMagic, 4);
  AppendLittleEndian(file, 2, 4);
  AppendLittleEndian(file, static_cast<std::uint32_t>(total), 4);
  AppendLittleEndian(file, static_cast<std::uint32_t>(json.size()), 4);
  AppendLittleEndian(file, kJsonChunk, 4);
  file += json;
  AppendLittleEndian(file, static_cast<std::uint32_t>(binary_.size()), 4);
  AppendLittleEndian(file, kBinaryChunk, 4);
  file += binary_;
  return file;
}

}  // namespace

absl::StatusOr<std::string> EncodeGlb(const SceneDescription& scene) {
  GlbBuilder builder;
  for (const absl::Status& status : {builder.AddTextures(scene.textures), builder.AddMaterials(scene),
                                     builder.AddMeshes(scene), builder.AddNodes(scene)}) {
    if (!status.ok()) return absl::InvalidArgumentError(absl::StrCat(scene.name, ": ", status.message()));
  }
  return std::move(builder).Finish();
}

absl::Status WriteFile(const std::string& path, const std::string& bytes) {
  const std::string partial = path + ".partial";
  std::ofstream file(partial, std::ios::binary | std::ios::trunc);
  file.write(bytes.data(), std::ssize(bytes));
  file.close();
  std::error_code error;
  if (!file) {
    std::filesystem::remove(partial, error);
    return absl::UnavailableError(absl::StrCat(path, ": cannot be written"));
  }
  std::filesystem::rename(partial, path, error);
  if (error) return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
  return absl::OkStatus();
}

}  // namespace lumifold::scenes
