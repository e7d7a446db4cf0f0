#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/plane.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

/// The smallest encoding that keeps every bit of the plane: constant, half, float. It depends on the values alone.
v1::PlaneEncoding EncodingOf(ConstFloatView plane);

/// Bytes of `count` values of a plane; of a constant plane those of its one value.
uint64_t EncodedBytes(v1::PlaneEncoding encoding, uint64_t count);

/// Appends the plane, whose EncodingOf is `encoding`, to `bytes`.
void AppendPlane(ConstFloatView plane, v1::PlaneEncoding encoding, std::string* bytes);

/// Decodes `count` values from their EncodedBytes.
void DecodeValues(v1::PlaneEncoding encoding, std::string_view bytes, float* values, size_t count);

/// Where a plane of an encoded picture is.
struct EncodedPlane {
  v1::PlaneEncoding encoding = v1::PLANE_ENCODING_FLOAT;
  uint64_t first_byte = 0;  // in the bytes of the picture

  /// First byte of row `y`, whose `width` values take EncodedBytes.
  uint64_t RowByte(int y, int width) const {
    const bool is_constant = encoding == v1::PLANE_ENCODING_CONSTANT;
    return first_byte +
           (is_constant ? 0
                        : EncodedBytes(encoding, static_cast<uint64_t>(y) * static_cast<uint64_t>(width)));
  }
};

/// The planes of a checked layout.
std::vector<EncodedPlane> PlanesOf(const v1::PixelLayout& layout);

}  // namespace lumifold::rpc
