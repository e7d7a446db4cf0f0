#include "worker/scene/accessors.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::scene {
namespace {

// An accessor without a buffer view is all zeros and costs the file no bytes, so its count needs a bound.
constexpr size_t kMaxElementsWithoutData = size_t{1} << 22;

/// `count` elements `stride` bytes apart; data is null if all are zero.
struct Elements {
  const char* data = nullptr;
  size_t count = 0;
  size_t stride = 0;
  int component_type = 0;
  int width = 0;
  bool normalized = false;
};

int ComponentBytes(int component_type) {
  switch (component_type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return 4;
    default:
      return 0;  // tinygltf accepts INT and DOUBLE, which glTF does not have
  }
}

absl::StatusOr<const tinygltf::Accessor*> Find(const Document& document, int accessor) {
  const auto& accessors = document.model.accessors;
  if (accessor < 0 || static_cast<size_t>(accessor) >= accessors.size()) {
    return absl::InvalidArgumentError(absl::StrCat("does not exist (there are ", accessors.size(), ")"));
  }
  return &accessors[accessor];
}

/// Sets `elements` to `offset` of buffer view `view`. Error: some of them lie outside the view.
absl::Status Locate(const Document& document, int view, size_t offset, Elements* elements) {
  const auto bytes = ViewBytes(document, view);
  if (!bytes.ok()) return bytes.status();
  const size_t element_bytes =
      static_cast<size_t>(ComponentBytes(elements->component_type)) * static_cast<size_t>(elements->width);
  elements->stride = document.model.bufferViews[view].byteStride;
  if (elements->stride == 0) elements->stride = element_bytes;
  if (elements->stride < element_bytes) {
    return absl::InvalidArgumentError(absl::StrCat("byteStride ", elements->stride, " of buffer view ", view,
                                                   " is less than an element of ", element_bytes, " bytes"));
  }
  const bool inside = elements->count == 0 ||
                      (offset <= bytes->size() && element_bytes <= bytes->size() - offset &&
                       elements->count - 1 <= (bytes->size() - offset - element_bytes) / elements->stride);
  if (!inside) {
    return absl::InvalidArgumentError(absl::StrCat(elements->count, " elements from byte ", offset,
                                                   " leave buffer view ", view, " of ", bytes->size(),
                                                   " bytes"));
  }
  elements->data = elements->count == 0 ? nullptr : bytes->data() + offset;
  return absl::OkStatus();
}

absl::StatusOr<Elements> LocateDense(const Document& document, const tinygltf::Accessor& accessor,
                                     int width) {
  if (tinygltf::GetNumComponentsInType(static_cast<uint32_t>(accessor.type)) != width ||
      accessor.type == TINYGLTF_TYPE_MAT2) {
    return absl::InvalidArgumentError(absl::StrCat("does not hold elements of ", width, " components"));
  }
  if (ComponentBytes(accessor.componentType) == 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("component type ", accessor.componentType, " is not glTF's"));
  }
  Elements elements{nullptr, accessor.count, 0, accessor.componentType, width, accessor.normalized};
  if (accessor.bufferView != kNone) {
    if (auto s = Locate(document, accessor.bufferView, accessor.byteOffset, &elements); !s.ok()) return s;
  } else if (accessor.count > kMaxElementsWithoutData) {
    return absl::ResourceExhaustedError(absl::StrCat(
        accessor.count, " elements without a buffer view, over the limit of ", kMaxElementsWithoutData));
  }
  return elements;
}

template <typename T>
T Load(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return value;
}

template <typename T>
float AsFloat(T value, bool normalized) {
  if constexpr (!std::is_floating_point_v<T>) {
    constexpr float kMax = static_cast<float>(std::numeric_limits<T>::max());
    if (normalized) return std::max(static_cast<float>(value) / kMax, -1.0f);
  }
  return static_cast<float>(value);
}

template <typename T>
void DecodeAs(const Elements& elements, float* out) {
  for (size_t i = 0; i < elements.count; ++i) {
    const char* at = elements.data + i * elements.stride;
    for (int c = 0; c < elements.width; ++c) {
      *out++ = AsFloat(Load<T>(at + static_cast<size_t>(c) * sizeof(T)), elements.normalized);
    }
  }
}

absl::Status Decode(const Elements& elements, float* out) {
  if (elements.data == nullptr) {
    std::fill_n(out, elements.count * static_cast<size_t>(elements.width), 0.0f);
    return absl::OkStatus();
  }
  switch (elements.component_type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      DecodeAs<int8_t>(elements, out);
      return absl::OkStatus();
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      DecodeAs<uint8_t>(elements, out);
      return absl::OkStatus();
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      DecodeAs<int16_t>(elements, out);
      return absl::OkStatus();
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      DecodeAs<uint16_t>(elements, out);
      return absl::OkStatus();
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      DecodeAs<float>(elements, out);
      return absl::OkStatus();
    default:
      return absl::InvalidArgumentError("32-bit integers are allowed for indices only");
  }
}

template <typename T>
void DecodeUnsignedAs(const Elements& elements, uint32_t* out) {
  for (size_t i = 0; i < elements.count; ++i) {
    const char* at = elements.data + i * elements.stride;
    for (int c = 0; c < elements.width; ++c) *out++ = Load<T>(at + static_cast<size_t>(c) * sizeof(T));
  }
}

absl::StatusOr<std::vector<uint32_t>> DecodeUnsigned(const Elements& elements) {
  std::vector<uint32_t> out(elements.count * static_cast<size_t>(elements.width));
  if (elements.data == nullptr) return out;
  switch (elements.component_type) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      DecodeUnsignedAs<uint8_t>(elements, out.data());
      return out;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      DecodeUnsignedAs<uint16_t>(elements, out.data());
      return out;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      DecodeUnsignedAs<uint32_t>(elements, out.data());
      return out;
    default:
      return absl::InvalidArgumentError(
          absl::StrCat("component type ", elements.component_type, " is not an index's"));
  }
}

/// Indices of the elements that a sparse accessor replaces.
absl::StatusOr<std::vector<uint32_t>> SparseTargets(const Document& document,
                                                    const tinygltf::Accessor& accessor) {
  const auto& sparse = accessor.sparse;
  // Versions of tinygltf differ in which of these have a sign.
  if (std::cmp_less(sparse.count, 0) || std::cmp_greater(sparse.count, accessor.count) ||
      std::cmp_less(sparse.indices.byteOffset, 0) || std::cmp_less(sparse.values.byteOffset, 0)) {
    return absl::InvalidArgumentError("its sparse part has a count or an offset out of range");
  }
  Elements elements{nullptr, static_cast<size_t>(sparse.count), 0, sparse.indices.componentType, 1, false};
  if (ComponentBytes(elements.component_type) == 0) {
    return absl::InvalidArgumentError("its sparse indices have no component type of glTF's");
  }
  if (auto s = Locate(document, sparse.indices.bufferView, static_cast<size_t>(sparse.indices.byteOffset),
                      &elements);
      !s.ok()) {
    return WithContext(s, "sparse indices");
  }
  auto targets = DecodeUnsigned(elements);
  if (!targets.ok()) return WithContext(targets.status(), "sparse indices");
  for (const uint32_t target : *targets) {
    if (target >= accessor.count) {
      return absl::InvalidArgumentError(
          absl::StrCat("sparse index ", target, " is out of range (", accessor.count, " elements)"));
    }
  }
  return targets;
}

absl::StatusOr<Elements> SparseValues(const Document& document, const tinygltf::Accessor& accessor,
                                      size_t count, int width) {
  Elements elements{nullptr, count, 0, accessor.componentType, width, accessor.normalized};
  const auto& values = accessor.sparse.values;
  auto s = Locate(document, values.bufferView, static_cast<size_t>(values.byteOffset), &elements);
  if (!s.ok()) return WithContext(s, "sparse values");
  return elements;
}

/// Replaces elements of `out`, which holds the accessor's elements from `first` on.
absl::Status ApplySparse(const Document& document, const tinygltf::Accessor& accessor, int width,
                         size_t first, size_t count, float* out) {
  const auto targets = SparseTargets(document, accessor);
  if (!targets.ok()) return targets.status();
  const auto elements = SparseValues(document, accessor, targets->size(), width);
  if (!elements.ok()) return elements.status();
  const size_t components = static_cast<size_t>(width);
  std::vector<float> values(targets->size() * components);
  if (auto s = Decode(*elements, values.data()); !s.ok()) return s;
  for (size_t i = 0; i < targets->size(); ++i) {
    const size_t target = (*targets)[i];
    if (target < first || target - first >= count) continue;
    std::copy_n(&values[i * components], components, out + (target - first) * components);
  }
  return absl::OkStatus();
}

absl::Status CheckFinite(const float* values, size_t count, int width) {
  for (size_t i = 0; i < count; ++i) {
    if (!std::isfinite(values[i])) {
      return absl::InvalidArgumentError(
          absl::StrCat("element ", i / static_cast<size_t>(width), " is not finite (NaN or infinity)"));
    }
  }
  return absl::OkStatus();
}

/// Decodes `count` elements from `first` on into `out`; they must exist.
absl::Status DecodeRange(const Document& document, const tinygltf::Accessor& accessor, Elements elements,
                         size_t first, size_t count, float* out) {
  if (elements.data != nullptr) elements.data += first * elements.stride;
  elements.count = count;
  if (auto s = Decode(elements, out); !s.ok()) return s;
  if (accessor.sparse.isSparse) {
    if (auto s = ApplySparse(document, accessor, elements.width, first, count, out); !s.ok()) return s;
  }
  return CheckFinite(out, count * static_cast<size_t>(elements.width), elements.width);
}

/// Reads elements of a type that consists of floats only.
template <typename Vec>
absl::StatusOr<std::vector<Vec>> ReadVectors(const Document& document, int index) {
  static_assert(std::is_trivially_copyable_v<Vec> && sizeof(Vec) % sizeof(float) == 0);
  const auto accessor = Find(document, index);
  if (!accessor.ok()) return accessor.status();
  const auto elements = LocateDense(document, **accessor, sizeof(Vec) / sizeof(float));
  if (!elements.ok()) return elements.status();
  std::vector<Vec> out(elements->count);
  auto s = DecodeRange(document, **accessor, *elements, 0, out.size(), reinterpret_cast<float*>(out.data()));
  if (!s.ok()) return s;
  return out;
}

absl::StatusOr<std::vector<float>> ReadUnnamedFloats(const Document& document, int index, int width,
                                                     size_t first, size_t count) {
  const auto accessor = Find(document, index);
  if (!accessor.ok()) return accessor.status();
  const auto elements = LocateDense(document, **accessor, width);
  if (!elements.ok()) return elements.status();
  if (first > elements->count || count > elements->count - first) {
    return absl::InvalidArgumentError(
        absl::StrCat(first + count, " elements are needed, it holds ", elements->count));
  }
  std::vector<float> out(count * static_cast<size_t>(width));
  if (auto s = DecodeRange(document, **accessor, *elements, first, count, out.data()); !s.ok()) return s;
  return out;
}

template <typename T>
absl::StatusOr<T> Named(absl::StatusOr<T> result, int index) {
  if (!result.ok()) return WithContext(result.status(), absl::StrCat("accessor ", index));
  return result;
}

absl::StatusOr<std::vector<uint32_t>> ReadUnnamedUnsigned(const Document& document, int index, int width) {
  const auto accessor = Find(document, index);
  if (!accessor.ok()) return accessor.status();
  const auto elements = LocateDense(document, **accessor, width);
  if (!elements.ok()) return elements.status();
  auto indices = DecodeUnsigned(*elements);
  if (!indices.ok() || !(*accessor)->sparse.isSparse) return indices;
  const auto targets = SparseTargets(document, **accessor);
  if (!targets.ok()) return targets.status();
  const auto replacements = SparseValues(document, **accessor, targets->size(), width);
  if (!replacements.ok()) return replacements.status();
  const auto values = DecodeUnsigned(*replacements);
  if (!values.ok()) return values.status();
  const auto components = static_cast<size_t>(width);
  for (size_t i = 0; i < targets->size(); ++i) {
    std::copy_n(&(*values)[i * components], components, &(*indices)[(*targets)[i] * components]);
  }
  return indices;
}

}  // namespace

absl::StatusOr<size_t> ElementCount(const Document& document, int accessor) {
  const auto found = Find(document, accessor);
  if (!found.ok()) return WithContext(found.status(), absl::StrCat("accessor ", accessor));
  return (*found)->count;
}

absl::StatusOr<std::vector<Vec2>> ReadVec2s(const Document& document, int accessor) {
  return Named(ReadVectors<Vec2>(document, accessor), accessor);
}

absl::StatusOr<std::vector<Vec3>> ReadVec3s(const Document& document, int accessor) {
  return Named(ReadVectors<Vec3>(document, accessor), accessor);
}

absl::StatusOr<std::vector<Vec4>> ReadVec4s(const Document& document, int accessor) {
  return Named(ReadVectors<Vec4>(document, accessor), accessor);
}

absl::StatusOr<std::vector<Vec4>> ReadColors(const Document& document, int accessor) {
  const auto found = Find(document, accessor);
  if (!found.ok() || (*found)->type != TINYGLTF_TYPE_VEC3) return ReadVec4s(document, accessor);
  const auto rgb = ReadVec3s(document, accessor);
  if (!rgb.ok()) return rgb.status();
  return OpaqueColors(*rgb);
}

std::vector<Vec4> OpaqueColors(const std::vector<Vec3>& rgb) {
  std::vector<Vec4> rgba;
  rgba.reserve(rgb.size());
  for (const Vec3& c : rgb) rgba.push_back({c.x, c.y, c.z, 1.0f});
  return rgba;
}

absl::StatusOr<std::vector<uint32_t>> ReadIndices(const Document& document, int accessor) {
  return Named(ReadUnnamedUnsigned(document, accessor, 1), accessor);
}

absl::StatusOr<std::vector<std::array<uint32_t, 4>>> ReadJoints(const Document& document, int accessor) {
  const auto flat = Named(ReadUnnamedUnsigned(document, accessor, 4), accessor);
  if (!flat.ok()) return flat.status();
  std::vector<std::array<uint32_t, 4>> joints(flat->size() / 4);
  for (size_t i = 0; i < flat->size(); ++i) joints[i / 4][i % 4] = (*flat)[i];
  return joints;
}

absl::StatusOr<std::vector<float>> ReadFloats(const Document& document, int accessor, int width, size_t first,
                                              size_t count) {
  return Named(ReadUnnamedFloats(document, accessor, width, first, count), accessor);
}

absl::StatusOr<std::vector<Affine>> ReadMatrices(const Document& document, int accessor) {
  const auto columns = Named(ReadVectors<std::array<Vec4, 4>>(document, accessor), accessor);
  if (!columns.ok()) return columns.status();
  std::vector<Affine> matrices;
  matrices.reserve(columns->size());
  const auto xyz = [](const Vec4& v) { return Vec3{v.x, v.y, v.z}; };
  for (const auto& c : *columns) matrices.push_back({xyz(c[0]), xyz(c[1]), xyz(c[2]), xyz(c[3])});
  return matrices;
}

}  // namespace lumifold::scene
