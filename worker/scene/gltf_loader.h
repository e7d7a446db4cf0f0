#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Gives the content of an external file by the URI the scene names it with (decoded), or an error that names
/// it.
using AssetReader = std::function<absl::StatusOr<std::string>(const std::string& uri)>;

/// What one scene may ask of this machine.
struct LoadLimits {
  int64_t max_triangles = int64_t{1} << 29;  // of unique meshes: instances do not count
  int64_t max_vertices =
      int64_t{1} << 32;  // read, once for each primitive and each morph target applied to it
  int64_t max_instances = int64_t{1} << 24;
  int64_t max_keyframes = int64_t{1} << 28;
  int64_t max_texture_pixels = int64_t{1} << 31;  // all textures together
  int max_node_depth = 256;
};

/// How a file becomes a Scene.
struct LoadOptions {
  /// The time on the animations' clock, seconds. Before its first keyframe and after its last one an animated
  /// property keeps that keyframe's value. All animations of the file play together.
  double time_seconds = 0;
  LoadLimits limits;
};

/// Reads glTF 2.0, text (.gltf) or binary (.glb; recognised by its magic), into a Scene as it
/// stands at `options.time_seconds`: nodes moved, meshes morphed and skinned. A skinned mesh is baked in
/// world space; its instance has the identity. Errors: kInvalidArgument, one line with `name`, the place
/// (mesh, accessor, node ...) and the cause, for anything malformed:
///   not glTF, a buffer cut short, an index out of range, a value that is not finite, a cycle among nodes, a
///   required extension that is not supported (naming it); kResourceExhausted over a limit; the reader's own
///   error for an external file.
/// Degenerate triangles are dropped and counted in a warning; a used but unsupported extension is one warning
/// naming it. Threads: safe concurrently. Equal bytes and options give an equal Scene.
absl::StatusOr<Scene> LoadGltf(std::string_view bytes, const std::string& name, const AssetReader& reader,
                               const LoadOptions& options = {});

/// Reads the file at `path`, external files relative to its folder.
absl::StatusOr<Scene> LoadGltfFile(const std::string& path, const LoadOptions& options = {});

}  // namespace lumifold::scene
