#include "client/assets.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/sha256.h"

namespace lumifold::client {
namespace {

using nlohmann::json;

constexpr int64_t kMaxJsonBytes = int64_t{256} << 20;
constexpr size_t kReadBytes = size_t{1} << 20;
// GLB (glTF 2.0, section 4.4): twelve bytes of header, then chunks of eight bytes of header and their data;
// JSON comes first.
constexpr size_t kGlbHeadBytes = 20;
constexpr absl::string_view kGlbMagic = "glTF";
constexpr absl::string_view kGlbJsonChunk = "JSON";

absl::Status Prefixed(absl::string_view prefix, const absl::Status& status) {
  return {status.code(), absl::StrCat(prefix, status.message())};
}

absl::StatusOr<std::ifstream> Open(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": is a folder, not a file"));
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    const int error = errno;
    return absl::Status(absl::ErrnoToStatusCode(error), absl::StrCat(path, ": ", std::strerror(error)));
  }
  return file;
}

uint32_t LittleEndian32(const char* bytes) {
  uint32_t value = 0;
  for (int i = 3; i >= 0; --i) value = (value << 8) | static_cast<unsigned char>(bytes[i]);
  return value;
}

absl::StatusOr<std::string> ReadPiece(std::ifstream& file, int64_t bytes) {
  std::string text(static_cast<size_t>(bytes), '\0');
  file.read(text.data(), bytes);
  if (file.gcount() != bytes) return absl::DataLossError("cannot be read to the end");
  return text;
}

// The JSON of a .glb or .gltf file. The content decides which of them it is, not the file name.
absl::StatusOr<std::string> ReadSceneJson(std::ifstream& file, int64_t file_bytes) {
  char head[kGlbHeadBytes] = {};
  file.read(head, sizeof head);
  const absl::string_view seen(head, static_cast<size_t>(file.gcount()));
  if (!absl::StartsWith(seen, kGlbMagic)) {
    if (file_bytes > kMaxJsonBytes) return absl::DataLossError("not a glTF file");
    file.clear();
    file.seekg(0);
    return ReadPiece(file, file_bytes);
  }
  if (seen.size() < kGlbHeadBytes) return absl::DataLossError("a GLB file that ends within its header");
  if (const uint32_t version = LittleEndian32(head + 4); version != 2) {
    return absl::DataLossError(absl::StrCat("glTF version ", version, "; only version 2 is supported"));
  }
  if (const int64_t stated = LittleEndian32(head + 8); stated > file_bytes) {
    return absl::DataLossError(absl::StrCat("a GLB file that is too short: it has ", file_bytes, " of the ",
                                            stated, " bytes its header states"));
  }
  const int64_t json_bytes = LittleEndian32(head + 12);
  if (absl::string_view(head + 16, 4) != kGlbJsonChunk || json_bytes > kMaxJsonBytes ||
      json_bytes > file_bytes - static_cast<int64_t>(kGlbHeadBytes)) {
    return absl::DataLossError("a GLB file whose first chunk is not JSON");
  }
  return ReadPiece(file, json_bytes);
}

absl::StatusOr<std::vector<std::string>> ReadExternalFiles(const std::string& scene_path) {
  absl::StatusOr<std::ifstream> file = Open(scene_path);
  if (!file.ok()) return file.status();
  std::error_code error;
  const auto bytes = static_cast<int64_t>(std::filesystem::file_size(scene_path, error));
  if (error) return absl::UnknownError(absl::StrCat(scene_path, ": ", error.message()));
  const absl::StatusOr<std::string> json_text = ReadSceneJson(*file, bytes);
  if (!json_text.ok()) return Prefixed(absl::StrCat(scene_path, ": "), json_text.status());
  absl::StatusOr<std::vector<std::string>> files = ExternalFiles(*json_text);
  if (!files.ok()) return Prefixed(absl::StrCat(scene_path, ": "), files.status());
  return files;
}

// "scheme:" of RFC 3986. A single letter is not a scheme: some exporters write a drive letter.
bool HasScheme(absl::string_view uri) {
  const size_t colon = uri.find(':');
  if (colon == absl::string_view::npos || colon < 2) return false;
  return std::all_of(uri.begin(), uri.begin() + static_cast<std::ptrdiff_t>(colon), [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '+' || c == '-' || c == '.';
  });
}

// Whether a message can carry the text: protobuf strings are UTF-8, and a path ends at a zero byte.
bool IsPlainUtf8(const std::string& text) {
  const std::string quoted = json(text).dump(-1, ' ', false, json::error_handler_t::replace);
  return json::parse(quoted) == text && text.find('\0') == std::string::npos;
}

// The name of the file that a URI refers to. Errors: without the place of the URI.
absl::StatusOr<std::string> FileOfUri(const std::string& uri) {
  if (uri.empty() || HasScheme(uri)) {
    return absl::DataLossError(absl::StrCat("'", uri, "'; only files and data: URIs are supported"));
  }
  std::string file = PercentDecoded(uri);
  if (!IsPlainUtf8(file)) {
    return absl::DataLossError(absl::StrCat("'", uri, "'; decoded, it is not a file name in UTF-8"));
  }
  if (absl::StartsWith(file, kEnvironmentScheme)) {
    return absl::DataLossError(
        absl::StrCat("'", uri, "'; names that begin with '", kEnvironmentScheme, "' are reserved"));
  }
  return file;
}

// Appends the files of one array of the scene ("buffers", "images").
absl::Status CollectFiles(const json& scene, const char* array_name, std::vector<std::string>* files) {
  const auto array = scene.find(array_name);
  if (array == scene.end() || !array->is_array()) return absl::OkStatus();
  for (size_t i = 0; i < array->size(); ++i) {
    const json& item = (*array)[i];
    const auto uri = item.is_object() ? item.find("uri") : item.end();
    if (!item.is_object() || uri == item.end() || !uri->is_string()) continue;
    const std::string& text = uri->get_ref<const std::string&>();
    if (absl::StartsWithIgnoreCase(text, "data:")) continue;
    absl::StatusOr<std::string> file = FileOfUri(text);
    if (!file.ok()) return Prefixed(absl::StrCat(array_name, "[", i, "].uri is "), file.status());
    if (std::find(files->begin(), files->end(), *file) == files->end()) files->push_back(*std::move(file));
  }
  return absl::OkStatus();
}

}  // namespace

std::string PercentDecoded(const std::string& uri) {
  std::string text;
  for (size_t i = 0; i < uri.size(); ++i) {
    const bool escaped = uri[i] == '%' && i + 2 < uri.size() &&
                         absl::ascii_isxdigit(static_cast<unsigned char>(uri[i + 1])) &&
                         absl::ascii_isxdigit(static_cast<unsigned char>(uri[i + 2]));
    text += escaped ? absl::HexStringToBytes(uri.substr(i + 1, 2)) : std::string(1, uri[i]);
    if (escaped) i += 2;
  }
  return text;
}

absl::StatusOr<std::vector<std::string>> ExternalFiles(const std::string& json_text) {
  const json scene = json::parse(json_text, /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (!scene.is_object() || !scene.contains("asset")) return absl::DataLossError("not a glTF file");
  std::vector<std::string> files;
  for (const char* array_name : {"buffers", "images"}) {
    if (const absl::Status status = CollectFiles(scene, array_name, &files); !status.ok()) return status;
  }
  return files;
}

absl::Status HashAsset(LocalAsset* asset) {
  absl::StatusOr<std::ifstream> file = Open(asset->path);
  if (!file.ok()) return file.status();
  rpc::Sha256 digest;
  std::string buffer(kReadBytes, '\0');
  uint64_t size = 0;
  while (*file) {
    file->read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    const auto count = static_cast<size_t>(file->gcount());
    digest.Update({buffer.data(), count});
    size += count;
  }
  if (!file->eof()) return absl::DataLossError(absl::StrCat(asset->path, ": cannot be read to the end"));
  asset->ref.set_sha256(digest.FinishHex());
  asset->ref.set_size(size);
  return absl::OkStatus();
}

absl::StatusOr<SceneAssets> FindSceneAssets(const std::string& scene_path) {
  const absl::StatusOr<std::vector<std::string>> files = ReadExternalFiles(scene_path);
  if (!files.ok()) return Prefixed("scene ", files.status());
  SceneAssets assets(1);
  assets.front().path = scene_path;
  const std::filesystem::path folder = std::filesystem::path(scene_path).parent_path();
  for (const std::string& file : *files) {
    LocalAsset asset;
    asset.path = (folder / file).string();
    asset.ref.set_uri(file);
    assets.push_back(std::move(asset));
  }
  for (LocalAsset& asset : assets) {
    const absl::Status hashed = HashAsset(&asset);
    if (!hashed.ok() && asset.ref.uri().empty()) return Prefixed("scene ", hashed);
    if (!hashed.ok())
      return Prefixed(absl::StrCat("scene ", scene_path, " needs ", asset.ref.uri(), ": "), hashed);
  }
  return assets;
}

v1::SceneRef MakeSceneRef(const SceneAssets& assets) {
  v1::SceneRef scene;
  *scene.mutable_file() = assets.front().ref;
  for (size_t i = 1; i < assets.size(); ++i) *scene.add_dependencies() = assets[i].ref;
  scene.set_display_name(std::filesystem::path(assets.front().path).filename().string());
  return scene;
}

}  // namespace lumifold::client
