#include "client/scene/assets.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/bounded_text.h"
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

absl::Status SystemError(const std::string& path) {
  const int error = errno;
  return {absl::ErrnoToStatusCode(error), absl::StrCat(path, ": ", std::strerror(error))};
}

absl::StatusOr<uint64_t> SizeOf(const rpc::FileHandle& file, const std::string& path) {
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return SystemError(path);
  return static_cast<uint64_t>(info.st_size);
}

/// At most `bytes` of the file from `offset` on; fewer at its end.
absl::StatusOr<std::string> ReadPiece(const rpc::FileHandle& file, uint64_t offset, size_t bytes) {
  std::string text(bytes, '\0');
  const int64_t count = ReadAt(file.get(), offset, text.data(), bytes);
  if (count < 0) return absl::DataLossError(StorageError("cannot be read", count).message());
  text.resize(static_cast<size_t>(count));
  return text;
}

uint32_t LittleEndian32(const char* bytes) {
  uint32_t value = 0;
  for (int i = 3; i >= 0; --i) value = (value << 8) | static_cast<unsigned char>(bytes[i]);
  return value;
}

// The JSON of a .glb or .gltf file. The content decides which of them it is, not the file name.
absl::StatusOr<std::string> ReadJson(const rpc::FileHandle& file, int64_t file_bytes) {
  const absl::StatusOr<std::string> head = ReadPiece(file, 0, kGlbHeadBytes);
  if (!head.ok()) return head.status();
  if (!absl::StartsWith(*head, kGlbMagic)) {
    if (file_bytes > kMaxJsonBytes) return absl::DataLossError("not a glTF file");
    return ReadPiece(file, 0, static_cast<size_t>(file_bytes));
  }
  if (head->size() < kGlbHeadBytes) return absl::DataLossError("a GLB file that ends within its header");
  if (const uint32_t version = LittleEndian32(head->data() + 4); version != 2) {
    return absl::DataLossError(absl::StrCat("glTF version ", version, "; only version 2 is supported"));
  }
  if (const int64_t stated = LittleEndian32(head->data() + 8); stated > file_bytes) {
    return absl::DataLossError(absl::StrCat("a GLB file that is too short: it has ", file_bytes, " of the ",
                                            stated, " bytes its header states"));
  }
  const int64_t json_bytes = LittleEndian32(head->data() + 12);
  if (absl::string_view(*head).substr(16) != kGlbJsonChunk || json_bytes > kMaxJsonBytes ||
      json_bytes > file_bytes - static_cast<int64_t>(kGlbHeadBytes)) {
    return absl::DataLossError("a GLB file whose first chunk is not JSON");
  }
  return ReadPiece(file, kGlbHeadBytes, static_cast<size_t>(json_bytes));
}

absl::StatusOr<std::vector<std::string>> ReadExternalFiles(const std::string& scene_path) {
  const absl::StatusOr<std::string> json_text = ReadSceneJson(scene_path);
  if (!json_text.ok()) return json_text.status();
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
  const auto refuse = [&uri](absl::string_view why) {
    return absl::DataLossError(absl::StrCat("'", Shown(uri), "'; ", why));
  };
  if (uri.empty() || HasScheme(uri)) return refuse("only files and data: URIs are supported");
  std::string file = PercentDecoded(uri);
  if (!IsPlainUtf8(file)) return refuse("decoded, it is not a file name in UTF-8");
  if (absl::StartsWith(file, kEnvironmentScheme))
    return refuse(absl::StrCat("names that begin with '", kEnvironmentScheme, "' are reserved"));
  if (const absl::Status status = CheckFileName(file); !status.ok()) return refuse(status.message());
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

// An error of an asset, with the place where its name comes from.
absl::Status NamedBy(const SceneAssets& assets, const LocalAsset& asset, const absl::Status& error) {
  if (&asset == &assets.front()) return Prefixed("scene ", error);
  if (asset.folder == nullptr) return Prefixed("--env ", error);
  return Prefixed(absl::StrCat("scene ", assets.front().path, " needs ", asset.ref.uri(), ": "), error);
}

// Stores the sizes of all files, before any of them is read.
absl::Status CheckSizes(const SceneFileRules& rules, SceneAssets* assets) {
  uint64_t total = 0;
  const LocalAsset* largest = nullptr;
  for (LocalAsset& asset : *assets) {
    const absl::StatusOr<rpc::FileHandle> file = OpenAsset(asset);
    if (!file.ok()) return NamedBy(*assets, asset, file.status());
    const absl::StatusOr<uint64_t> size = SizeOf(*file, asset.path);
    if (!size.ok()) return NamedBy(*assets, asset, size.status());
    if (*size > rules.max_file_bytes) {
      return NamedBy(*assets, asset,
                     absl::ResourceExhaustedError(
                         absl::StrCat(asset.path, ": has ", *size, " bytes, over the limit of ",
                                      rules.max_file_bytes, " for a file; --max-file-mb raises it")));
    }
    asset.ref.set_size(*size);
    total += *size;
    if (largest == nullptr || *size > largest->ref.size()) largest = &asset;
  }
  if (total <= rules.max_job_bytes) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrCat("scene ", assets->front().path, ": its files have ", total,
                                                   " bytes, over the limit of ", rules.max_job_bytes,
                                                   " for a job; --max-job-mb raises it; the largest is ",
                                                   largest->path, " with ", largest->ref.size()));
}

}  // namespace

absl::StatusOr<std::string> ReadSceneJson(const std::string& scene_path) {
  const absl::StatusOr<rpc::FileHandle> file = OpenRegularFile(scene_path);
  if (!file.ok()) return file.status();
  const absl::StatusOr<uint64_t> bytes = SizeOf(*file, scene_path);
  if (!bytes.ok()) return bytes.status();
  absl::StatusOr<std::string> json_text = ReadJson(*file, static_cast<int64_t>(*bytes));
  if (!json_text.ok()) return Prefixed(absl::StrCat(scene_path, ": "), json_text.status());
  return json_text;
}

std::string PercentDecoded(const std::string& uri) {
  std::string text;
  for (size_t i = 0; i < uri.size(); ++i) {
    uint32_t byte = 0;
    const bool escaped = uri[i] == '%' && i + 2 < uri.size() &&
                         absl::ascii_isxdigit(static_cast<unsigned char>(uri[i + 1])) &&
                         absl::ascii_isxdigit(static_cast<unsigned char>(uri[i + 2])) &&
                         absl::SimpleHexAtoi(uri.substr(i + 1, 2), &byte);
    text += escaped ? static_cast<char>(byte) : uri[i];
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

absl::StatusOr<rpc::FileHandle> OpenAsset(const LocalAsset& asset) {
  return asset.folder == nullptr ? OpenRegularFile(asset.path) : asset.folder->OpenFile(asset.ref.uri());
}

absl::StatusOr<std::string> ReadAsset(const LocalAsset& asset) {
  const absl::StatusOr<rpc::FileHandle> file = OpenAsset(asset);
  if (!file.ok()) return file.status();
  absl::StatusOr<std::string> content = ReadPiece(*file, 0, asset.ref.size());
  if (!content.ok()) return Prefixed(absl::StrCat(asset.path, ": "), content.status());
  if (rpc::Sha256Hex(*content) != asset.ref.sha256())
    return absl::DataLossError(absl::StrCat(asset.path, ": changed while it was read"));
  return content;
}

absl::Status HashAsset(LocalAsset* asset) {
  const absl::StatusOr<rpc::FileHandle> file = OpenAsset(*asset);
  if (!file.ok()) return file.status();
  const absl::StatusOr<uint64_t> size = SizeOf(*file, asset->path);
  if (!size.ok()) return size.status();
  rpc::Sha256 digest;
  uint64_t done = 0;
  while (done < *size) {
    const absl::StatusOr<std::string> piece =
        ReadPiece(*file, done, static_cast<size_t>(std::min<uint64_t>(kReadBytes, *size - done)));
    if (!piece.ok()) return Prefixed(absl::StrCat(asset->path, ": "), piece.status());
    if (piece->empty())
      return absl::DataLossError(absl::StrCat(asset->path, ": became shorter while it was read"));
    digest.Update(*piece);
    done += piece->size();
  }
  asset->ref.set_sha256(digest.FinishHex());
  asset->ref.set_size(*size);
  return absl::OkStatus();
}

absl::StatusOr<SceneAssets> FindSceneAssets(const std::string& scene_path, const SceneFileRules& rules) {
  const absl::StatusOr<std::vector<std::string>> files = ReadExternalFiles(scene_path);
  if (!files.ok()) return Prefixed("scene ", files.status());
  absl::StatusOr<SceneFolder> opened = SceneFolder::Open(scene_path, rules.allowed_folders);
  if (!opened.ok()) return opened.status();
  const auto folder = std::make_shared<const SceneFolder>(*std::move(opened));
  SceneAssets assets(1);
  assets.front().path = scene_path;
  for (const std::string& file : *files) {
    LocalAsset asset;
    asset.path = folder->PathOf(file);
    asset.folder = folder;
    asset.ref.set_uri(file);
    assets.push_back(std::move(asset));
  }
  return assets;
}

absl::Status HashAssets(const SceneFileRules& rules, SceneAssets* assets) {
  if (absl::Status status = CheckSizes(rules, assets); !status.ok()) return status;
  for (LocalAsset& asset : *assets) {
    if (const absl::Status hashed = HashAsset(&asset); !hashed.ok()) return NamedBy(*assets, asset, hashed);
  }
  return absl::OkStatus();
}

v1::SceneRef MakeSceneRef(const SceneAssets& assets) {
  v1::SceneRef scene;
  *scene.mutable_file() = assets.front().ref;
  for (size_t i = 1; i < assets.size(); ++i) *scene.add_dependencies() = assets[i].ref;
  scene.set_display_name(rpc::AsUtf8(std::filesystem::path(assets.front().path).filename().string()));
  return scene;
}

}  // namespace lumifold::client
