#include "proto/rpc/plane_codec.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace lumifold::rpc {
namespace {

static_assert(std::endian::native == std::endian::little, "values are sent in the byte order of memory");

// binary16: 1 bit of sign, 5 of exponent with bias 15, 10 of mantissa; binary32: 1, 8 with bias 127, 23. Only
// integers are used, because a thread may treat denormals as zero.
constexpr uint32_t kSign = 0x80000000;
constexpr int kDroppedBits = 23 - 10;
constexpr uint32_t kBiases = uint32_t{127 - 15} << 23;
constexpr uint32_t kHalfInfinity = 31u << 10;
constexpr uint32_t kLeastNormal = uint32_t{127 - 14} << 23;  // 2^-14, bits of a float
constexpr uint32_t kBeyondHalf = uint32_t{127 + 16} << 23;   // 2^16
constexpr float kLeastHalf = 0x1p-24f;
constexpr float kGreatestHalf = 65504.0f;

uint32_t BitsOf(float value) { return std::bit_cast<uint32_t>(value); }

/// Whether a half has exactly this value. NaN and infinities stay floats.
bool IsHalf(float value) {
  const uint32_t magnitude = BitsOf(value) & ~kSign;
  if (magnitude == 0) return true;
  if (magnitude >= kBeyondHalf) return false;
  if (magnitude >= kLeastNormal) return (magnitude & ((1u << kDroppedBits) - 1)) == 0;
  // A multiple of 2^-24, if it is none smaller than that.
  const int shift = static_cast<int>(kLeastNormal >> 23) + kDroppedBits - static_cast<int>(magnitude >> 23);
  return shift <= 23 && (magnitude & ((1u << shift) - 1)) == 0;
}

/// The half of a value that IsHalf.
uint16_t HalfOf(float value) {
  const uint32_t bits = BitsOf(value);
  const uint32_t sign = (bits & kSign) >> 16;
  const uint32_t magnitude = bits & ~kSign;
  if (magnitude >= kLeastNormal) return static_cast<uint16_t>(sign | (magnitude - kBiases) >> kDroppedBits);
  if (magnitude == 0) return static_cast<uint16_t>(sign);
  const uint32_t mantissa = (magnitude & 0x7fffff) | 0x800000;
  const uint32_t shift = (kLeastNormal >> 23) + kDroppedBits - (magnitude >> 23);
  return static_cast<uint16_t>(sign | mantissa >> shift);
}

float FloatOf(uint16_t half) {
  const uint32_t sign = (half & 0x8000u) << 16;
  const uint32_t magnitude = half & 0x7fffu;
  if (magnitude < 1u << 10)
    return std::bit_cast<float>(BitsOf(static_cast<float>(magnitude) * kLeastHalf) | sign);
  const uint32_t exponent = magnitude >= kHalfInfinity ? 2 * kBiases : kBiases;
  return std::bit_cast<float>(sign | ((magnitude << kDroppedBits) + exponent));
}

/// Halves away from zero.
float NearestHalf(float value) {
  if (std::isnan(value)) return 0;
  const float bounded = std::clamp(value, -kGreatestHalf, kGreatestHalf);
  const uint32_t bits = BitsOf(bounded);
  if ((bits & ~kSign) < kLeastNormal) return std::round(bounded / kLeastHalf) * kLeastHalf;
  constexpr uint32_t kDropped = (1u << kDroppedBits) - 1;
  const float rounded = std::bit_cast<float>((bits + (1u << (kDroppedBits - 1))) & ~kDropped);
  return std::clamp(rounded, -kGreatestHalf, kGreatestHalf);
}

template <typename Predicate>
bool AllOf(ConstFloatView plane, Predicate is) {
  for (int y = 0; y < plane.height(); ++y) {
    for (const float* value = plane.Row(y); value != plane.Row(y) + plane.width(); ++value) {
      if (!is(*value)) return false;
    }
  }
  return true;
}

}  // namespace

v1::PlaneEncoding EncodingOf(ConstFloatView plane) {
  const uint32_t first = BitsOf(plane.At(0, 0));
  if (AllOf(plane, [first](float value) { return BitsOf(value) == first; }))
    return v1::PLANE_ENCODING_CONSTANT;
  return AllOf(plane, IsHalf) ? v1::PLANE_ENCODING_HALF : v1::PLANE_ENCODING_FLOAT;
}

void RoundToHalf(FloatView plane) {
  for (int y = 0; y < plane.height(); ++y) {
    for (float* value = plane.Row(y); value != plane.Row(y) + plane.width(); ++value)
      *value = NearestHalf(*value);
  }
}

uint64_t EncodedBytes(v1::PlaneEncoding encoding, uint64_t count) {
  switch (encoding) {
    case v1::PLANE_ENCODING_CONSTANT:
      return sizeof(float);
    case v1::PLANE_ENCODING_HALF:
      return count * sizeof(uint16_t);
    default:
      return count * sizeof(float);
  }
}

void AppendPlane(ConstFloatView plane, v1::PlaneEncoding encoding, std::string* bytes) {
  if (encoding == v1::PLANE_ENCODING_CONSTANT) {
    bytes->append(reinterpret_cast<const char*>(plane.Row(0)), sizeof(float));
    return;
  }
  for (int y = 0; y < plane.height(); ++y) {
    const float* row = plane.Row(y);
    const auto width = static_cast<size_t>(plane.width());
    if (encoding == v1::PLANE_ENCODING_FLOAT) {
      bytes->append(reinterpret_cast<const char*>(row), width * sizeof(float));
      continue;
    }
    for (size_t x = 0; x < width; ++x) {
      const uint16_t half = HalfOf(row[x]);
      bytes->append(reinterpret_cast<const char*>(&half), sizeof(half));
    }
  }
}

void DecodeValues(v1::PlaneEncoding encoding, std::string_view bytes, float* values, size_t count) {
  switch (encoding) {
    case v1::PLANE_ENCODING_CONSTANT:
      std::memcpy(values, bytes.data(), sizeof(float));
      std::fill_n(values + 1, count - 1, *values);
      return;
    case v1::PLANE_ENCODING_HALF:
      for (size_t i = 0; i < count; ++i) {
        uint16_t half;
        std::memcpy(&half, bytes.data() + i * sizeof(half), sizeof(half));
        values[i] = FloatOf(half);
      }
      return;
    default:
      std::memcpy(values, bytes.data(), count * sizeof(float));
  }
}

std::vector<EncodedPlane> PlanesOf(const v1::PixelLayout& layout) {
  const uint64_t area = static_cast<uint64_t>(layout.width()) * static_cast<uint64_t>(layout.height());
  std::vector<EncodedPlane> planes(static_cast<size_t>(layout.channels_size()));
  uint64_t first_byte = 0;
  int compressed = 0;
  for (size_t i = 0; i < planes.size(); ++i) {
    EncodedPlane& plane = planes[i];
    if (static_cast<int>(i) < layout.encodings_size()) plane.encoding = layout.encodings(static_cast<int>(i));
    plane.first_byte = first_byte;
    if (plane.encoding != v1::PLANE_ENCODING_ZSTD) {
      plane.size_bytes = EncodedBytes(plane.encoding, area);
    } else if (compressed < layout.compressed_bytes_size()) {
      plane.size_bytes = layout.compressed_bytes(compressed++);
    }
    first_byte += plane.size_bytes;
  }
  return planes;
}

}  // namespace lumifold::rpc
