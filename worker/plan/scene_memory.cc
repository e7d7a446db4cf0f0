#include "worker/plan/scene_memory.h"

#include <algorithm>
#include <vector>

namespace lumifold::plan {
namespace {

/// Of a process that has loaded a small scene.
constexpr uint64_t kProcessBytes = uint64_t{96} << 20;
/// Embree's copy of a vertex, and of a triangle with its share of the tree, while the tree is built.
constexpr uint64_t kVertexBytes = 12;
constexpr uint64_t kTriangleBytes = 250;
constexpr uint64_t kInstanceBytes = 600;

template <typename T>
uint64_t BytesOf(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

uint64_t BytesOf(const scene::Mesh& mesh) {
  return BytesOf(mesh.positions) + BytesOf(mesh.normals) + BytesOf(mesh.uvs[0]) + BytesOf(mesh.uvs[1]) +
         BytesOf(mesh.tangents) + BytesOf(mesh.colors) + BytesOf(mesh.triangles);
}

}  // namespace

uint64_t SceneMemory(const scene::Scene& scene, uint64_t file_bytes, uint64_t environment_bytes) {
  uint64_t arrays = 0;
  uint64_t tree = scene.instances.size() * kInstanceBytes;
  for (const scene::Mesh& mesh : scene.meshes) {
    arrays += BytesOf(mesh);
    tree += mesh.positions.size() * kVertexBytes + mesh.triangles.size() / 3 * kTriangleBytes;
  }
  uint64_t pictures = environment_bytes;
  for (const scene::SharedImage& image : scene.images) {
    if (image != nullptr) pictures += image->bytes() * 4 / 3;
  }
  const uint64_t frame = arrays + std::max(tree, file_bytes);
  return kProcessBytes + pictures + (scene.animated ? 2 : 1) * frame;
}

}  // namespace lumifold::plan
