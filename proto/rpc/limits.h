#pragma once

#include <cstddef>

namespace lumifold::rpc {

/// Maximum bytes of pixels or of a file in one chunk.
inline constexpr size_t kMaxChunkBytes = size_t{1} << 20;

/// Maximum bytes of one message, on every channel and server: a chunk with its names, and reserve.
inline constexpr int kMaxMessageBytes = 4 << 20;

}  // namespace lumifold::rpc
