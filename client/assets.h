#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/scene.pb.h"

namespace lumifold::client {

/// Prefix of the uri of an environment map, which is not a file that the scene names.
inline constexpr char kEnvironmentScheme[] = "environment:";

/// A file of a scene: its local path and its reference for the coordinator.
struct LocalAsset {
  std::string path;
  v1::AssetRef ref;
};

/// The scene file (with an empty uri), then every external file it names, each once, in the order of first
/// use. Their uri is percent-decoded: the worker looks files up by this form.
using SceneAssets = std::vector<LocalAsset>;

/// Reads the URIs of the scene's buffers and images and hashes these files. Relative URIs are relative to the
/// scene's folder and may leave it; data: URIs are ignored. Errors, each naming the scene: kNotFound for the
/// scene or a file it names; kDataLoss for a file that is not glTF 2.0, a GLB file that is too short, or a
/// URI that names no file; kPermissionDenied and others from the system.
absl::StatusOr<SceneAssets> FindSceneAssets(const std::string& scene_path);

/// Stores the SHA-256 of the file (lower-case hexadecimal) and its size in `asset->ref`.
/// Errors: those of the system, naming the file.
absl::Status HashAsset(LocalAsset* asset);

/// The scene of a job: its assets, with the name of the scene file as display name.
v1::SceneRef MakeSceneRef(const SceneAssets& assets);

/// The external files named in a scene's JSON text, percent-decoded, each once, in the order of first use.
/// Errors: kDataLoss with the cause, without the scene's name.
absl::StatusOr<std::vector<std::string>> ExternalFiles(const std::string& json_text);

/// "wood%20floor.png" -> "wood floor.png". A % without two hexadecimal digits after it is not changed. The
/// worker decodes the scene's URIs the same way (scene::PercentDecode).
std::string PercentDecoded(const std::string& uri);

}  // namespace lumifold::client
