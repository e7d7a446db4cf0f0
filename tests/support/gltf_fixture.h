#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "nlohmann/json.hpp"
#include "worker/scene/gltf_loader.h"

// Instantiated once, in gltf_fixture.cc.
extern template class nlohmann::basic_json<>;

namespace lumifold::scene {

/// Builds small glTF documents in memory. Tests may change `json` before they call Glb() or Text().
class GltfFixture {
 public:
  nlohmann::json json = {{"asset", {{"version", "2.0"}}}};
  std::string binary;

  /// Appends bytes to the binary part as a new buffer view and returns its index.
  int AddView(std::string_view bytes, int stride = 0);

  /// An accessor over a new view of `values`; `type` is "SCALAR", "VEC3" ...
  int AddFloats(const std::vector<float>& values, const std::string& type);
  int AddBytes(const std::vector<uint8_t>& values, const std::string& type, bool normalized);
  int AddShorts(const std::vector<int16_t>& values, const std::string& type, bool normalized);
  int AddIndices(const std::vector<uint32_t>& values);

  /// A mesh of one primitive with this JSON; returns its index.
  int AddMesh(const nlohmann::json& primitive);

  /// A node with this JSON, not yet in a scene; returns its index.
  int AddNode(const nlohmann::json& node);

  /// Appends `object` to the array `section` and returns its index.
  int Add(const char* section, const nlohmann::json& object);

  /// A mesh with positions only, in a node of its own; the members of `primitive` are added to its primitive.
  /// Returns the mesh's index.
  int AddTriangles(const std::vector<float>& positions,
                   const nlohmann::json& primitive = nlohmann::json::object());

  /// `json` and, if there is a binary part, buffer 0 for it.
  nlohmann::json FullJson() const;

  /// The document as GLB.
  std::string Glb() const;

  /// The document as text, with this URI for buffer 0.
  std::string Text(const std::string& uri) const;

  /// Loads Glb() under the name "test.glb"; external files do not exist.
  absl::StatusOr<Scene> Load(const LoadOptions& options = {}) const;

 private:
  int AddAccessor(std::string_view bytes, int component_type, size_t count, const std::string& type,
                  bool normalized);
};

/// The files of a document that has none: none exists.
inline absl::StatusOr<std::string> NoFiles(const std::string& uri) {
  return absl::NotFoundError(uri + " does not exist");
}

/// A unit right triangle in the xy plane.
inline const std::vector<float> kTriangle = {0, 0, 0, 1, 0, 0, 0, 1, 0};

/// `json` and `binary` as a GLB, without a binary chunk if `binary` is empty.
std::string MakeGlb(std::string json, std::string binary);

/// Encodes `samples` (rows from the top, `channels` 1 to 4 of 8 or 16 bits, big-endian) as PNG.
std::string EncodePng(int width, int height, int channels, int bits, bool interlaced,
                      const std::vector<uint8_t>& samples);

/// Encodes 8-bit samples of 1 (grey), 3 (RGB) or 4 (CMYK) channels as JPEG of the best quality.
std::string EncodeJpeg(int width, int height, int channels, bool progressive,
                       const std::vector<uint8_t>& samples);

}  // namespace lumifold::scene
