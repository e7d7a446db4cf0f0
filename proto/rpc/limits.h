#pragma once

#include <cstddef>

namespace lumifold::rpc {

/// Bytes of pixels or file one chunk carries at most.
inline constexpr size_t kMaxChunkBytes = size_t{1} << 20;

/// Bytes of one message at most, on every channel and server: a chunk, its names and room to spare.
inline constexpr int kMaxMessageBytes = 4 << 20;

}  // namespace lumifold::rpc
