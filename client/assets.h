#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/scene.pb.h"

namespace lumifold::client {

/// A file a scene needs, as it is called here and as the coordinator knows it.
struct LocalAsset {
  std::string path;
  v1::AssetRef ref;
};

/// The scene file first (its uri empty), then every external file it names, each uri once, in the order they
/// are named.
using SceneAssets = std::vector<LocalAsset>;

/// Reads the scene's JSON for the URIs of buffers and images that are files, and hashes them all. Relative
/// URIs start at the scene's folder and may climb out of it; data: URIs stay where they are. Errors, each
/// naming the scene: kNotFound for the scene or a file it names; kDataLoss for what is no glTF 2.0, a
/// GLB cut short, or a URI that is not a file's; kPermissionDenied and others as the system says.
absl::StatusOr<SceneAssets> FindSceneAssets(const std::string& scene_path);

/// SHA-256 of the file in lower-case hexadecimal, and its size, into `asset->ref`. Errors: as the system
/// says, naming the file.
absl::Status HashAsset(LocalAsset* asset);

/// The scene as a job names it: its assets, called after the scene's file for people.
v1::SceneRef MakeSceneRef(const SceneAssets& assets);

/// The external files named in a scene's JSON text, each once, in the order they are named.
/// Errors: kDataLoss saying what is wrong, naming no file (the caller knows it).
absl::StatusOr<std::vector<std::string>> ExternalUris(const std::string& json_text);

/// "wood%20floor.png" -> "wood floor.png"; a % that two hexadecimal digits do not follow stays.
std::string PercentDecoded(const std::string& uri);

}  // namespace lumifold::client
