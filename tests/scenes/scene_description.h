#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tests/scenes/geometry.h"

namespace lumifold::scenes {

enum class TextureId : int {};
enum class MaterialId : int {};
enum class MeshId : int {};

/// An 8-bit sRGB picture, row 0 at the top, that repeats in both directions.
struct Texture {
  std::string name;
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb = {};  ///< width * height * 3 bytes
};

/// A glTF metallic-roughness material. Colours are linear.
struct Material {
  std::string name;
  Vec3 base_color = {0.8, 0.8, 0.8};
  double metallic = 0;
  double roughness = 1;
  double specular = 1;      ///< KHR_materials_specular factor; 0 leaves a pure Lambert surface
  double transmission = 0;  ///< KHR_materials_transmission factor
  bool is_solid = false;  ///< KHR_materials_volume: the mesh bounds a solid, which refracts; else a thin pane
  Vec3 emission = {};     ///< emitted radiance, any size; seen from the front side only
  bool unlit = false;     ///< KHR_materials_unlit: base_color is what is seen
  bool double_sided = false;
  std::optional<TextureId> texture = std::nullopt;  ///< multiplied into base_color
  Vec2 texture_size_m = {1, 1};  ///< metres of surface that one repeat of the texture covers
};

/// Triangles with smooth normals. Counter-clockwise is the front.
struct Mesh {
  std::vector<Vec3> positions;  ///< metres
  std::vector<Vec3> normals;    ///< unit
  std::vector<Vec2> uvs;        ///< metres along the surface, v upwards; the material scales them
  std::vector<std::uint32_t> indices;
};

/// The part of a mesh that has one material.
struct Primitive {
  Mesh mesh;
  MaterialId material;
};

struct NamedMesh {
  std::string name;
  std::vector<Primitive> primitives;
};

/// One instance of a mesh.
struct Node {
  std::string name;
  MeshId mesh;
  Transform transform = {};
};

struct Camera {
  Transform transform = {};
  double vertical_fov_degrees = 45;
};

/// The contents of one .glb file: plain data, written by `EncodeGlb`.
struct SceneDescription {
  std::string name;
  std::vector<Texture> textures = {};
  std::vector<Material> materials = {};
  std::vector<NamedMesh> meshes = {};
  std::vector<Node> nodes = {};
  Camera camera = {};

  TextureId Add(Texture texture);
  MaterialId Add(Material material);
  MeshId Add(std::string mesh_name, std::vector<Primitive> primitives);
  void Place(std::string node_name, MeshId mesh, const Transform& transform = {});
  /// A mesh that is used once: `Add` and `Place` under one name.
  void PlaceOnce(std::string mesh_name, std::vector<Primitive> primitives, const Transform& transform = {});

  /// As rendered: a mesh counts once for every node that uses it.
  std::int64_t InstancedTriangles() const;
  /// As stored in the file.
  std::int64_t UniqueTriangles() const;
  /// As rendered, of materials that emit.
  std::int64_t EmissiveTriangles() const;
};

}  // namespace lumifold::scenes
