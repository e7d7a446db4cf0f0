#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace lumifold::scene {

/// Whether a stream of mode ATTRIBUTES is of version 1, which only KHR_meshopt_compression has.
bool IsVertexCodeVersion1(std::string_view code);

/// Decodes such a stream to `count` elements of `stride` bytes, a multiple of 4 up to 256. Returns false if
/// it is damaged. Source: KHR_meshopt_compression, appendix A, mode 0.
bool DecodeVertexCode(std::string_view code, size_t count, size_t stride, std::string* elements);

}  // namespace lumifold::scene
