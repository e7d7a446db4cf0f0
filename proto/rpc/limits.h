#pragma once

#include <cstddef>

namespace lumifold::rpc {

/// Maximum bytes of pixels or of a file in one chunk.
inline constexpr size_t kMaxChunkBytes = size_t{1} << 20;

/// Maximum bytes of one message, on every channel and server: a chunk with its names, and reserve.
inline constexpr int kMaxMessageBytes = 4 << 20;

/// Maximum bytes of one warning of a unit, and number of warnings of a unit: 16 KiB together.
inline constexpr size_t kMaxWarningBytes = 512;
inline constexpr size_t kMaxUnitWarnings = 32;

/// Maximum number of objects that a unit names, bytes of a name, and of all names.
inline constexpr size_t kMaxObjects = 16384;
inline constexpr size_t kMaxObjectNameBytes = 255;
inline constexpr size_t kMaxObjectBytes = size_t{512} << 10;

/// Maximum bytes of an error text, of a unit, of a job, or of a call. gRPC sends it in trailers of at most 8
/// KiB, in which a byte may take three.
inline constexpr size_t kMaxErrorBytes = 2048;

/// Maximum number of lines of a worker's log in one message, and bytes of one.
inline constexpr size_t kMaxTailLines = 32;
inline constexpr size_t kMaxTailLineBytes = 1024;

/// Maximum bytes of the name and of the numeric class of a worker.
inline constexpr size_t kMaxWorkerNameBytes = 256;

/// Maximum number of tags of a worker or a job, and bytes of one.
inline constexpr size_t kMaxTags = 32;
inline constexpr size_t kMaxTagBytes = 64;

/// Maximum bytes of the reason of a block.
inline constexpr size_t kMaxReasonBytes = 512;

}  // namespace lumifold::rpc
