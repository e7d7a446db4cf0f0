#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/scene/scene_folder.h"
#include "lumifold/v1/scene.pb.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::client {

/// Prefix of the uri of an environment map, which is not a file that the scene names.
inline constexpr char kEnvironmentScheme[] = "environment:";

/// A file of a job: its local path and its reference for the coordinator.
struct LocalAsset {
  std::string path;
  v1::AssetRef ref;
  /// Of a file that the scene names, which is not trusted; null for one that the user named.
  std::shared_ptr<const SceneFolder> folder;
};

/// Opens the asset's file, however often, with the same checks each time.
/// Errors: those of OpenRegularFile and SceneFolder::OpenFile.
absl::StatusOr<rpc::FileHandle> OpenAsset(const LocalAsset& asset);

/// The content of a hashed asset's file. Errors: those of OpenAsset; kDataLoss, naming the file, if its size
/// or content differs from its reference.
absl::StatusOr<std::string> ReadAsset(const LocalAsset& asset);

/// The scene file (with an empty uri), then every external file it names, each once, in the order of first
/// use. Their uri is percent-decoded: the worker looks files up by this form.
using SceneAssets = std::vector<LocalAsset>;

/// The JSON text of a scene file. Errors, with the file's name: kNotFound; kDataLoss for a GLB file that is
/// too short or has no JSON; kInvalidArgument for what is no regular file; those of the system.
absl::StatusOr<std::string> ReadSceneJson(const std::string& scene_path);

/// Reads the URIs of the scene's buffers and images; data: URIs are ignored. Opens none of these files.
/// Errors, each naming the scene: kNotFound for the scene; kDataLoss for a file that is not glTF 2.0, a GLB
/// file that is too short, or a URI that is not the name of a file; kInvalidArgument for what is no regular
/// file; those of SceneFolder::Open and of the system.
absl::StatusOr<SceneAssets> FindSceneAssets(const std::string& scene_path, const SceneFileRules& rules);

/// Checks the sizes of all files and then hashes them: HashAsset for each.
/// Errors: those of OpenAsset and HashAsset with the scene's name; kResourceExhausted for a file or job over
/// a limit, before any file is read, naming file, size, limit and the option that raises it.
absl::Status HashAssets(const SceneFileRules& rules, SceneAssets* assets);

/// Stores the SHA-256 of the file (lower-case hexadecimal) and its size in `asset->ref`.
/// Errors: those of OpenAsset and the system, naming the file.
absl::Status HashAsset(LocalAsset* asset);

/// The scene of a job: its assets, with the name of the scene file as display name.
v1::SceneRef MakeSceneRef(const SceneAssets& assets);

/// The external files named in a scene's JSON text, percent-decoded, each once, in the order of first use.
/// Their names pass CheckFileName.
/// Errors: kDataLoss with the cause, without the scene's name.
absl::StatusOr<std::vector<std::string>> ExternalFiles(const std::string& json_text);

/// "wood%20floor.png" -> "wood floor.png". A % without two hexadecimal digits after it is not changed. The
/// worker decodes the scene's URIs the same way (scene::PercentDecode).
std::string PercentDecoded(const std::string& uri);

}  // namespace lumifold::client
