#include "tests/scenes/scene_description.h"

#include <utility>

namespace lumifold::scenes {
namespace {

std::int64_t TriangleCount(const NamedMesh& mesh) {
  std::int64_t count = 0;
  for (const Primitive& primitive : mesh.primitives) count += std::ssize(primitive.mesh.indices) / 3;
  return count;
}

}  // namespace

TextureId SceneDescription::Add(Texture texture) {
  textures.push_back(std::move(texture));
  return TextureId{static_cast<int>(textures.size()) - 1};
}

MaterialId SceneDescription::Add(Material material) {
  materials.push_back(std::move(material));
  return MaterialId{static_cast<int>(materials.size()) - 1};
}

MeshId SceneDescription::Add(std::string mesh_name, std::vector<Primitive> primitives) {
  meshes.push_back({std::move(mesh_name), std::move(primitives)});
  return MeshId{static_cast<int>(meshes.size()) - 1};
}

void SceneDescription::Place(std::string node_name, MeshId mesh, const Transform& transform) {
  nodes.push_back({std::move(node_name), mesh, transform});
}

void SceneDescription::PlaceOnce(std::string mesh_name, std::vector<Primitive> primitives,
                                 const Transform& transform) {
  const MeshId mesh = Add(mesh_name, std::move(primitives));
  Place(std::move(mesh_name), mesh, transform);
}

std::int64_t SceneDescription::InstancedTriangles() const {
  std::int64_t count = 0;
  for (const Node& node : nodes) count += TriangleCount(meshes[static_cast<int>(node.mesh)]);
  return count;
}

std::int64_t SceneDescription::UniqueTriangles() const {
  std::int64_t count = 0;
  for (const NamedMesh& mesh : meshes) count += TriangleCount(mesh);
  return count;
}

std::int64_t SceneDescription::EmissiveTriangles() const {
  std::int64_t count = 0;
  for (const Node& node : nodes) {
    for (const Primitive& primitive : meshes[static_cast<int>(node.mesh)].primitives) {
      const bool emits = materials[static_cast<int>(primitive.material)].emission != Vec3{};
      if (emits) count += std::ssize(primitive.mesh.indices) / 3;
    }
  }
  return count;
}

}  // namespace lumifold::scenes
