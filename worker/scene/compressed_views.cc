#include "worker/scene/compressed_views.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "absl/strings/str_cat.h"
#include "nlohmann/json.hpp"
#include "worker/scene/diagnostics.h"
#include "worker/scene/vertex_codes.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;
using Mode = CompressedView::Mode;
using Filter = CompressedView::Filter;

constexpr const char* kExtensions[] = {"KHR_meshopt_compression", "EXT_meshopt_compression"};

/// The tightest code of attributes, of version 1: four bytes that stay the same in 256 elements take one.
/// Indices take more than a 64th.
constexpr uint64_t kMaxExpansion = 1024;
constexpr uint64_t kMaxIndexExpansion = 64;
constexpr uint64_t kMaxLength = uint64_t{1} << 40;

const json* FindExtension(const json& object) {
  const auto extensions = object.find("extensions");
  if (extensions == object.end() || !extensions->is_object()) return nullptr;
  for (const char* name : kExtensions) {
    const auto found = extensions->find(name);
    if (found != extensions->end() && found->is_object()) return &*found;
  }
  return nullptr;
}

absl::StatusOr<uint64_t> ReadSize(const json& extension, const char* key, bool is_required) {
  const auto found = extension.find(key);
  if (found == extension.end() && !is_required) return uint64_t{0};
  if (found == extension.end() || !found->is_number_unsigned())
    return absl::InvalidArgumentError(absl::StrCat("no ", key));
  return found->get<uint64_t>();
}

template <typename Value, size_t kCount>
absl::StatusOr<Value> ReadName(const json& extension, const char* key, const char* otherwise,
                               const std::pair<const char*, Value> (&names)[kCount]) {
  const auto found = extension.find(key);
  const std::string text =
      found != extension.end() && found->is_string() ? found->get<std::string>() : otherwise;
  for (const auto& [name, value] : names) {
    if (text == name) return value;
  }
  return absl::InvalidArgumentError(absl::StrCat(key, " \"", text, "\" is not known"));
}

constexpr std::pair<const char*, Mode> kModes[] = {
    {"ATTRIBUTES", Mode::kAttributes}, {"TRIANGLES", Mode::kTriangles}, {"INDICES", Mode::kIndices}};
constexpr std::pair<const char*, Filter> kFilters[] = {{"NONE", Filter::kIdentity},
                                                       {"OCTAHEDRAL", Filter::kOctahedral},
                                                       {"QUATERNION", Filter::kQuaternion},
                                                       {"EXPONENTIAL", Filter::kExponential},
                                                       {"COLOR", Filter::kColor}};

bool AllowsStride(const CompressedView& view) {
  const uint64_t stride = view.stride;
  if (view.mode != Mode::kAttributes) return stride == 2 || stride == 4;
  if (stride == 0 || stride > 256 || stride % 4 != 0) return false;
  if (view.filter == Filter::kOctahedral || view.filter == Filter::kColor) return stride == 4 || stride == 8;
  return view.filter != Filter::kQuaternion || stride == 8;
}

absl::Status Check(const CompressedView& view) {
  if (!AllowsStride(view))
    return absl::InvalidArgumentError(absl::StrCat("byteStride ", view.stride, " does not fit its mode"));
  if (view.mode == Mode::kTriangles && view.count % 3 != 0)
    return absl::InvalidArgumentError(absl::StrCat("count ", view.count, " is not that of triangles"));
  if (view.mode != Mode::kAttributes && view.filter != Filter::kIdentity)
    return absl::InvalidArgumentError("a filter on indices");
  const uint64_t expansion = view.mode == Mode::kAttributes ? kMaxExpansion : kMaxIndexExpansion;
  if (view.length > kMaxLength || view.count > expansion * view.length / view.stride + 256) {
    return absl::InvalidArgumentError(
        absl::StrCat("claims ", view.count, " elements, but has only ", view.length, " bytes"));
  }
  return absl::OkStatus();
}

absl::StatusOr<CompressedView> Parse(const json& extension) {
  CompressedView view;
  struct {
    const char* key;
    uint64_t* value;
    bool is_required;
  } const sizes[] = {{"byteOffset", &view.offset, false},
                     {"byteLength", &view.length, true},
                     {"byteStride", &view.stride, true},
                     {"count", &view.count, true}};
  for (const auto& [key, value, is_required] : sizes) {
    const auto size = ReadSize(extension, key, is_required);
    if (!size.ok()) return size.status();
    *value = *size;
  }
  const auto buffer = ReadSize(extension, "buffer", true);
  const auto mode = ReadName(extension, "mode", "", kModes);
  const auto filter = ReadName(extension, "filter", "NONE", kFilters);
  for (const absl::Status& s : {buffer.status(), mode.status(), filter.status()}) {
    if (!s.ok()) return s;
  }
  view.buffer = static_cast<int64_t>(std::min<uint64_t>(*buffer, std::numeric_limits<int32_t>::max()));
  view.mode = *mode;
  view.filter = *filter;
  if (auto s = Check(view); !s.ok()) return s;
  return view;
}

/// The colour filter of KHR_meshopt_compression: luma, two differences of chroma with a sign, and alpha, all
/// with as many bits as the highest bit of alpha says; afterwards red, green, blue and alpha over all bits.
template <typename T>
void DecodeColors(char* data, size_t count) {
  constexpr float kMax = std::numeric_limits<T>::max();
  for (size_t i = 0; i < count; ++i, data += 4 * sizeof(T)) {
    T in[4];
    std::memcpy(in, data, sizeof(in));
    int largest = in[3];
    for (int shift = 1; shift < 16; shift *= 2) largest |= largest >> shift;
    const int luma = in[0];
    constexpr int kSign = 1 << (8 * sizeof(T) - 1);
    const int orange = (in[1] ^ kSign) - kSign;  // with its sign
    const int green = (in[2] ^ kSign) - kSign;
    const int alpha = ((in[3] << 1) & largest) | (in[3] & 1);
    const int values[4] = {luma + orange - green, luma + green, luma - orange - green, alpha};
    T out[4] = {};
    for (int c = 0; c < 4; ++c) {
      const float scaled =
          largest == 0 ? 0.0f : static_cast<float>(values[c]) * kMax / static_cast<float>(largest);
      out[c] = static_cast<T>(std::lround(std::clamp(scaled, 0.0f, kMax)));
    }
    std::memcpy(data, out, sizeof(out));
  }
}

void ApplyFilter(const CompressedView& view, std::string* bytes) {
  switch (view.filter) {
    case Filter::kIdentity:
      return;
    case Filter::kOctahedral:
      return meshopt_decodeFilterOct(bytes->data(), view.count, view.stride);
    case Filter::kQuaternion:
      return meshopt_decodeFilterQuat(bytes->data(), view.count, view.stride);
    case Filter::kExponential:
      return meshopt_decodeFilterExp(bytes->data(), view.count, view.stride);
    case Filter::kColor:
      if (view.stride == 4) return DecodeColors<uint8_t>(bytes->data(), view.count);
      return DecodeColors<uint16_t>(bytes->data(), view.count);
  }
}

/// Returns whether the code is whole.
bool Decompress(const CompressedView& view, std::string_view code, std::string* bytes) {
  const auto* data = reinterpret_cast<const unsigned char*>(code.data());
  switch (view.mode) {
    case Mode::kAttributes:
      // The library reads this version since its 0.23.
      if (IsVertexCodeVersion1(code)) return DecodeVertexCode(code, view.count, view.stride, bytes);
      return meshopt_decodeVertexBuffer(bytes->data(), view.count, view.stride, data, code.size()) == 0;
    case Mode::kTriangles:
      return meshopt_decodeIndexBuffer(bytes->data(), view.count, view.stride, data, code.size()) == 0;
    default:
      return meshopt_decodeIndexSequence(bytes->data(), view.count, view.stride, data, code.size()) == 0;
  }
}

}  // namespace

absl::StatusOr<std::vector<CompressedView>> FindCompressedViews(const json& buffer_views) {
  std::vector<CompressedView> views;
  for (size_t i = 0; i < buffer_views.size(); ++i) {
    const json* extension = FindExtension(buffer_views[i]);
    if (extension == nullptr) continue;
    auto view = Parse(*extension);
    if (!view.ok()) return WithContext(view.status(), absl::StrCat("compressed buffer view ", i));
    view->view = static_cast<int>(i);
    views.push_back(*view);
  }
  return views;
}

bool IsFallbackBuffer(const json& buffer) {
  const json* extension = FindExtension(buffer);
  return extension != nullptr && extension->value("fallback", json(false)) == json(true);
}

absl::StatusOr<std::string> DecodeView(const CompressedView& view,
                                       const std::vector<std::string_view>& buffers) {
  const std::string_view buffer =
      static_cast<size_t>(view.buffer) < buffers.size() ? buffers[view.buffer] : std::string_view();
  if (view.offset > buffer.size() || view.length > buffer.size() - view.offset) {
    return absl::InvalidArgumentError(absl::StrCat(view.length, " bytes from ", view.offset, " leave buffer ",
                                                   view.buffer, " of ", buffer.size(), " bytes"));
  }
  std::string bytes(view.count * view.stride, '\0');
  // The library's decoders check every length and index, and say no more than that something is wrong.
  if (view.count > 0 && !Decompress(view, buffer.substr(view.offset, view.length), &bytes))
    return absl::InvalidArgumentError("damaged meshopt data, or of a version that is not read");
  ApplyFilter(view, &bytes);
  return bytes;
}

}  // namespace lumifold::scene
