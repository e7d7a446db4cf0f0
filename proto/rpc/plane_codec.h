#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/plane.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

// Constant, half and float, in which each row can be read by itself. plane_compression.h has the fourth
// encoding.

/// The first of constant, half and float that keeps every bit of the plane. It depends on the values alone.
v1::PlaneEncoding EncodingOf(ConstFloatView plane);

/// Bytes of `count` values of a plane that is not compressed; of a constant plane those of its one value.
uint64_t EncodedBytes(v1::PlaneEncoding encoding, uint64_t count);

/// Appends the plane in an encoding that keeps its bits to `bytes`.
void AppendPlane(ConstFloatView plane, v1::PlaneEncoding encoding, std::string* bytes);

/// Decodes `count` values from their EncodedBytes.
void DecodeValues(v1::PlaneEncoding encoding, std::string_view bytes, float* values, size_t count);

/// Replaces each value by the nearest that PLANE_ENCODING_HALF can hold; NaN by 0. Values beyond its range
/// become the largest.
void RoundToHalf(FloatView plane);

/// Where a plane of an encoded picture is.
struct EncodedPlane {
  v1::PlaneEncoding encoding = v1::PLANE_ENCODING_FLOAT;
  uint64_t first_byte = 0;  // in the bytes of the picture
  uint64_t size_bytes = 0;

  /// First byte of row `y`, whose `width` values take EncodedBytes; of a plane that is not compressed.
  uint64_t RowByte(int y, int width) const {
    const bool is_constant = encoding == v1::PLANE_ENCODING_CONSTANT;
    return first_byte +
           (is_constant ? 0
                        : EncodedBytes(encoding, static_cast<uint64_t>(y) * static_cast<uint64_t>(width)));
  }
};

/// The planes of a layout. Where it has too few sizes of compressed planes, those planes have no bytes.
std::vector<EncodedPlane> PlanesOf(const v1::PixelLayout& layout);

}  // namespace lumifold::rpc
