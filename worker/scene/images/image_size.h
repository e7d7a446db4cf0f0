#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "worker/scene/scene.h"

/// What every decoder of pictures checks before it allocates memory.
namespace lumifold::scene {

/// Errors: kInvalidArgument without pixels; kResourceExhausted over `max_pixels`, or over 2^20 along a side.
absl::Status CheckImageSize(uint64_t width, uint64_t height, int64_t max_pixels);

/// Error: kInvalidArgument if `bytes` of a format that holds at most `pixels_per_byte` cannot hold the
/// picture: it is a decompression bomb or truncated.
absl::Status CheckImageBytes(uint64_t width, uint64_t height, int64_t pixels_per_byte, int64_t bytes);

/// A picture of zeros, of a size that CheckImageSize accepts. `is_deep`: with 16 bits a channel.
ImageData EmptyImage(uint64_t width, uint64_t height, bool is_deep = false);

}  // namespace lumifold::scene
