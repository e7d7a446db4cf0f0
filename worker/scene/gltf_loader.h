#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "filter/image/parallel.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Returns the content of an external file, given the scene's URI for it (decoded), or an error that names
/// it.
using AssetReader = std::function<absl::StatusOr<std::string>(const std::string& uri)>;

/// Decodes the file of a picture of at most `max_pixels` pixels: DecodeImage, or a cache in front of it.
/// Called by several threads at a time.
using ImageDecoder = std::function<absl::StatusOr<SharedImage>(std::string_view file, int64_t max_pixels)>;

/// Resource limits for one scene.
struct LoadLimits {
  int64_t max_triangles = int64_t{1} << 29;  // of unique meshes: instances do not count
  int64_t max_vertices =
      int64_t{1} << 32;  // read: for each primitive and for each morph target applied to it
  int64_t max_instances = int64_t{1} << 24;
  int64_t max_keyframes = int64_t{1} << 28;
  int64_t max_texture_pixels = int64_t{1} << 31;  // all textures together
  int max_node_depth = 256;
};

/// Extras property of a node whose mesh shows shadows alone: any value but false, 0 and null. The Blender
/// add-on writes it.
inline constexpr char kShadowCatcher[] = "lumifold_shadow_catcher";

/// Options of LoadGltf.
struct LoadOptions {
  /// Animation time in seconds. Before its first and after its last keyframe an animated property has that
  /// keyframe's value.
  double time_seconds = 0;
  /// Name or number of the only animation that plays. Empty: all play together, but for those that move
  /// what an earlier one moves, which are left out with a warning.
  std::string animation;
  /// Name or number of the variant of KHR_materials_variants that is shown; empty: none.
  std::string variant;
  /// Whether nodes with the extras property kShadowCatcher become catchers. Otherwise they are shown like
  /// others, with a warning.
  bool catches_shadows = false;
  LoadLimits limits;
  ImageDecoder decode;       // empty: DecodeImage
  TaskPool* pool = nullptr;  // decodes textures; null: this thread does
};

/// Reads glTF 2.0, text (.gltf) or binary (.glb; recognised by its magic), into a Scene at
/// `options.time_seconds`, with nodes animated and meshes morphed and skinned. A skinned mesh is stored in
/// world space; its instance has the identity. Degenerate triangles are dropped and counted in a warning; a
/// used but unsupported extension gives one warning that names it.
/// Errors:  kInvalidArgument, one line with `name`, the place (mesh, accessor, node ...) and the cause, for
///          malformed files: not glTF, a truncated buffer, an index out of range, a value that is not finite,
///          a cycle among nodes, a required extension that is not supported (naming it); kResourceExhausted
///          over a limit; the reader's own error for an external file.
/// Threads: safe concurrently. Equal bytes and options give an equal Scene.
absl::StatusOr<Scene> LoadGltf(std::string_view bytes, const std::string& name, const AssetReader& reader,
                               const LoadOptions& options = {});

/// Reads the file at `path`; external files are relative to its folder.
absl::StatusOr<Scene> LoadGltfFile(const std::string& path, const LoadOptions& options = {});

}  // namespace lumifold::scene
