#include "worker/scene/document.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "nlohmann/json.hpp"
#include "worker/scene/compressed_views.h"
#include "worker/scene/pointers.h"
#include "worker/scene/uri.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;

// Far more than any exporter needs. Bounds the stack of functions that traverse JSON recursively.
constexpr int kMaxJsonDepth = 128;

struct Container {
  std::string_view json_text;
  std::string_view binary;
  bool has_binary = false;
};

uint32_t LittleEndian32(std::string_view bytes) {
  const auto byte = [&](size_t i) { return uint32_t{static_cast<unsigned char>(bytes[i])}; };
  return byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24;
}

/// Removes the next chunk (length, type, content) from the front of `rest`.
absl::StatusOr<std::pair<uint32_t, std::string_view>> TakeChunk(std::string_view* rest) {
  constexpr size_t kHeaderBytes = 8;
  if (rest->size() < kHeaderBytes) return absl::InvalidArgumentError("GLB cut short in a chunk's header");
  const uint32_t length = LittleEndian32(*rest);
  const uint32_t type = LittleEndian32(rest->substr(4));
  rest->remove_prefix(kHeaderBytes);
  if (length > rest->size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("GLB cut short: a chunk of ", length, " bytes has only ", rest->size()));
  }
  const std::string_view content = rest->substr(0, length);
  rest->remove_prefix(length);
  return std::make_pair(type, content);
}

absl::StatusOr<Container> SplitGlb(std::string_view bytes) {
  constexpr size_t kHeaderBytes = 12;
  constexpr uint32_t kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;
  if (bytes.size() < kHeaderBytes) return absl::InvalidArgumentError("GLB cut short in its header");
  const uint32_t version = LittleEndian32(bytes.substr(4));
  const uint32_t length = LittleEndian32(bytes.substr(8));
  if (version != 2)
    return absl::InvalidArgumentError(absl::StrCat("GLB version ", version, ", only 2 is read"));
  if (length < kHeaderBytes || length > bytes.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("GLB cut short: its header says ", length, " bytes, there are ", bytes.size()));
  }
  std::string_view rest = bytes.substr(kHeaderBytes, length - kHeaderBytes);
  Container container;
  auto chunk = TakeChunk(&rest);
  if (!chunk.ok()) return chunk.status();
  if (chunk->first != kJsonChunk) return absl::InvalidArgumentError("GLB whose first chunk is not JSON");
  container.json_text = chunk->second;
  if (rest.empty()) return container;
  chunk = TakeChunk(&rest);
  if (!chunk.ok()) return chunk.status();
  container.has_binary = chunk->first == kBinaryChunk;
  if (container.has_binary) container.binary = chunk->second;
  return container;  // further chunks belong to extensions; glTF tells readers to skip them
}

absl::StatusOr<Container> SplitContainer(std::string_view bytes) {
  if (bytes.substr(0, 4) == "glTF") return SplitGlb(bytes);
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (bytes.substr(0, kByteOrderMark.size()) == kByteOrderMark) bytes.remove_prefix(kByteOrderMark.size());
  const size_t start = bytes.find_first_not_of(" \t\r\n");
  if (start == std::string_view::npos || bytes[start] != '{') {
    return absl::InvalidArgumentError("not glTF: neither a GLB nor a JSON object");
  }
  return Container{bytes, {}, false};
}

/// Error: the JSON is nested so deeply that recursive readers would overflow the stack. Ignores brackets in
/// strings.
absl::Status CheckJsonDepth(std::string_view text) {
  int depth = 0;
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      if (++depth > kMaxJsonDepth) {
        return absl::InvalidArgumentError(absl::StrCat("JSON nested deeper than ", kMaxJsonDepth, " levels"));
      }
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  return absl::OkStatus();
}

bool FitsItsType(const json& value, bool is_size) {
  if (!value.is_number_integer()) return true;
  if (value.is_number_unsigned()) {
    return is_size || value.get<uint64_t>() <= uint64_t{std::numeric_limits<int32_t>::max()};
  }
  return value.get<int64_t>() >= (is_size ? 0 : std::numeric_limits<int32_t>::min());
}

/// Properties of glTF that are real numbers, or arrays of them, and may be written without a point: Blender
/// writes 999999995904 for a far plane without end.
bool IsReal(std::string_view key) {
  constexpr std::string_view kReals[] = {
      "aspectRatio", "intensity",   "matrix",  "max",  "min",  "range", "rotation", "scale",
      "strength",    "translation", "weights", "xmag", "yfov", "ymag",  "zfar",     "znear"};
  return std::find(std::begin(kReals), std::end(kReals), key) != std::end(kReals);
}

/// Path and value of the first integer that does not fit tinygltf's type and would wrap around to a valid but
/// wrong one. tinygltf reads all integers except sizes as int.
std::optional<std::string> FindOutOfRangeInteger(const json& value, bool is_size) {
  if (!value.is_structured()) {
    if (FitsItsType(value, is_size)) return std::nullopt;
    return absl::StrCat(": ", value.dump());
  }
  for (auto child = value.begin(); child != value.end(); ++child) {
    bool child_is_size = is_size;
    if (value.is_object()) {
      const std::string& key = child.key();
      if (key == "extras" || IsReal(key)) continue;
      child_is_size = key == "byteOffset" || key == "byteLength" || key == "count";
    }
    const auto found = FindOutOfRangeInteger(*child, child_is_size);
    if (!found.has_value()) continue;
    return absl::StrCat("/", value.is_object() ? child.key() : absl::StrCat(child - value.begin()), *found);
  }
  return std::nullopt;
}

absl::Status CheckVersion(const json& root) {
  const auto asset = root.find("asset");
  if (asset == root.end() || !asset->is_object()) {
    return absl::InvalidArgumentError("not glTF: no \"asset\" object");
  }
  const auto version = asset->find("version");
  if (version == asset->end() || !version->is_string()) return absl::InvalidArgumentError("no glTF version");
  const std::string text = version->get<std::string>();
  if (!text.starts_with("2.")) {
    return absl::InvalidArgumentError(absl::StrCat("glTF version ", text, ", only 2.x is read"));
  }
  return absl::OkStatus();
}

/// Removes the array `section` from the document and returns it; empty if there is none.
absl::StatusOr<json> TakeSection(json* root, const char* section) {
  const auto found = root->find(section);
  if (found == root->end()) return json::array();
  json taken = std::move(*found);
  root->erase(found);
  if (!taken.is_array()) return absl::InvalidArgumentError(absl::StrCat("\"", section, "\" is not an array"));
  for (size_t i = 0; i < taken.size(); ++i) {
    if (!taken[i].is_object())
      return absl::InvalidArgumentError(absl::StrCat(section, "[", i, "] is not an object"));
  }
  return taken;
}

std::string StringOr(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

absl::StatusOr<std::string_view> ReadBuffer(const json& buffer, bool is_first, const Container& container,
                                            const AssetReader& reader, Document* document) {
  const auto length = buffer.find("byteLength");
  if (length == buffer.end() || !length->is_number_unsigned())
    return absl::InvalidArgumentError("no byteLength");
  if (IsFallbackBuffer(buffer)) return std::string_view();
  const std::string uri = StringOr(buffer, "uri", "");
  std::string_view content;
  if (!uri.empty()) {
    auto read = ReadUri(uri, reader);
    if (!read.ok()) return read.status();
    content = document->owned.emplace_back(*std::move(read));
  } else if (is_first && container.has_binary) {
    content = container.binary;
  } else {
    return absl::InvalidArgumentError("neither a uri nor a GLB's binary part");
  }
  const uint64_t wanted = length->get<uint64_t>();
  if (content.size() < wanted) {
    return absl::InvalidArgumentError(
        absl::StrCat("cut short: byteLength is ", wanted, ", there are ", content.size(), " bytes"));
  }
  return content.substr(0, wanted);
}

absl::Status ReadBuffers(const json& buffers, const Container& container, const AssetReader& reader,
                         Document* document) {
  for (size_t i = 0; i < buffers.size(); ++i) {
    const auto content = ReadBuffer(buffers[i], i == 0, container, reader, document);
    if (!content.ok()) {
      return WithContext(content.status(),
                         Place("buffer", static_cast<int64_t>(i), StringOr(buffers[i], "name", "")));
    }
    document->buffers.push_back(*content);
  }
  return absl::OkStatus();
}

absl::Status DecodeViews(const std::vector<CompressedView>& compressed, Document* document) {
  for (const CompressedView& view : compressed) {
    auto bytes = DecodeView(view, document->buffers);
    if (!bytes.ok()) return WithContext(bytes.status(), absl::StrCat("compressed buffer view ", view.view));
    document->decoded_views[view.view] = document->owned.emplace_back(*std::move(bytes));
  }
  return absl::OkStatus();
}

absl::Status ReadImageSources(const json& images, Document* document) {
  for (const json& image : images) {
    ImageSource source{StringOr(image, "name", ""), kNone, StringOr(image, "uri", "")};
    const auto view = image.find("bufferView");
    if (view != image.end() && view->is_number_integer()) source.view = view->get<int>();
    if ((source.view == kNone) == source.uri.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(Place("image", static_cast<int64_t>(document->images.size()), source.name),
                       ": needs either a uri or a bufferView"));
    }
    document->images.push_back(std::move(source));
  }
  return absl::OkStatus();
}

/// Removes the index accessor from primitives compressed with Draco. It has no buffer view, which tinygltf
/// rejects, and Draco's data contains the indices.
void DropCompressedIndices(json* root) {
  const auto meshes = root->find("meshes");
  if (meshes == root->end() || !meshes->is_array()) return;
  for (json& mesh : *meshes) {
    if (!mesh.is_object() || !mesh.contains("primitives") || !mesh["primitives"].is_array()) continue;
    for (json& primitive : mesh["primitives"]) {
      if (!primitive.is_object() || !primitive.contains("extensions")) continue;
      const json& extensions = primitive["extensions"];
      if (extensions.is_object() && extensions.contains("KHR_draco_mesh_compression")) {
        primitive.erase("indices");
      }
    }
  }
}

absl::Status ParseModel(const json& root, tinygltf::Model* model) {
  const std::string text = root.dump();
  if (text.size() > std::numeric_limits<unsigned int>::max()) {
    return absl::ResourceExhaustedError("more than 4 GiB of JSON");
  }
  tinygltf::TinyGLTF parser;
  std::string error, warning;
  const bool parsed = parser.LoadASCIIFromString(model, &error, &warning, text.data(),
                                                 static_cast<unsigned int>(text.size()), "");
  // tinygltf skips some malformed objects and reports them in `error` only; an incomplete scene is an error.
  if (parsed && error.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(error.empty() ? "malformed glTF" : absl::StripSuffix(error, "\n"));
}

bool HasPointed(const std::vector<Animation>& animations) {
  return std::any_of(animations.begin(), animations.end(), [](const Animation& animation) {
    return std::any_of(animation.channels.begin(), animation.channels.end(),
                       [](const AnimationChannel& c) { return c.property == AnimatedProperty::kPointed; });
  });
}

}  // namespace

absl::Status SetPointedValues(const std::vector<PointedValue>& values, Document* document) {
  json root = json::parse(document->animated_json);
  for (const PointedValue& value : values) {
    if (auto s = SetPointed(value.pointer, value.values, &root); !s.ok()) return s;
  }
  tinygltf::Model model;
  if (auto s = ParseModel(root, &model); !s.ok()) return s;
  for (size_t i = 0; i < model.nodes.size(); ++i) {
    tinygltf::Node& posed = document->model.nodes[i];
    model.nodes[i].translation = std::move(posed.translation);
    model.nodes[i].rotation = std::move(posed.rotation);
    model.nodes[i].scale = std::move(posed.scale);
    model.nodes[i].weights = std::move(posed.weights);
  }
  document->model = std::move(model);
  return absl::OkStatus();
}

absl::StatusOr<std::string> ReadUri(const std::string& uri, const AssetReader& reader) {
  if (IsDataUri(uri)) return DecodeDataUri(uri);
  const std::string decoded = PercentDecode(uri);
  if (!reader)
    return absl::InvalidArgumentError(absl::StrCat("external file ", decoded, " cannot be read here"));
  return reader(decoded);
}

absl::StatusOr<Document> ParseDocument(std::string_view bytes, const AssetReader& reader,
                                       Diagnostics* diagnostics) {
  const auto container = SplitContainer(bytes);
  if (!container.ok()) return container.status();
  if (auto s = CheckJsonDepth(container->json_text); !s.ok()) return s;
  json root = json::parse(container->json_text);
  if (!root.is_object()) return absl::InvalidArgumentError("not glTF: the JSON is not an object");
  if (auto s = CheckVersion(root); !s.ok()) return s;
  if (const auto out_of_range = FindOutOfRangeInteger(root, false); out_of_range.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(*out_of_range, " is out of range"));
  }

  Document document;
  const auto buffers = TakeSection(&root, "buffers");
  if (!buffers.ok()) return buffers.status();
  const auto images = TakeSection(&root, "images");
  if (!images.ok()) return images.status();
  const auto animations = TakeSection(&root, "animations");
  if (!animations.ok()) return animations.status();
  const auto skins = TakeSection(&root, "skins");
  if (!skins.ok()) return skins.status();
  const auto compressed = FindCompressedViews(root.value("bufferViews", json::array()));
  if (!compressed.ok()) return compressed.status();
  DropCompressedIndices(&root);
  if (auto s = ParseModel(root, &document.model); !s.ok()) return s;
  if (auto s = ParseAnimations(*animations, &document.animations, diagnostics); !s.ok()) return s;
  if (HasPointed(document.animations)) document.animated_json = root.dump();
  root = nullptr;
  if (auto s = ReadImageSources(*images, &document); !s.ok()) return s;
  if (auto s = ParseSkins(*skins, &document.skins); !s.ok()) return s;
  if (auto s = ReadBuffers(*buffers, *container, reader, &document); !s.ok()) return s;
  if (auto s = DecodeViews(*compressed, &document); !s.ok()) return s;
  return document;
}

absl::StatusOr<std::string_view> ViewBytes(const Document& document, int view) {
  const auto& views = document.model.bufferViews;
  if (view < 0 || static_cast<size_t>(view) >= views.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("buffer view ", view, " does not exist (there are ", views.size(), ")"));
  }
  const tinygltf::BufferView& v = views[view];
  if (const auto decoded = document.decoded_views.find(view); decoded != document.decoded_views.end()) {
    if (v.byteLength <= decoded->second.size()) return decoded->second.substr(0, v.byteLength);
    return absl::InvalidArgumentError(absl::StrCat("buffer view ", view, ": ", v.byteLength, " bytes of ",
                                                   decoded->second.size(), " decoded ones"));
  }
  if (v.buffer < 0 || static_cast<size_t>(v.buffer) >= document.buffers.size()) {
    return absl::InvalidArgumentError(absl::StrCat("buffer view ", view, ": buffer ", v.buffer,
                                                   " does not exist (there are ", document.buffers.size(),
                                                   ")"));
  }
  const std::string_view buffer = document.buffers[v.buffer];
  if (v.byteOffset > buffer.size() || v.byteLength > buffer.size() - v.byteOffset) {
    return absl::InvalidArgumentError(absl::StrCat("buffer view ", view, ": ", v.byteLength, " bytes from ",
                                                   v.byteOffset, " leave buffer ", v.buffer, " of ",
                                                   buffer.size(), " bytes"));
  }
  return buffer.substr(v.byteOffset, v.byteLength);
}

}  // namespace lumifold::scene
