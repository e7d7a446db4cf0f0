#pragma once

#include <cstdint>
#include <string_view>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Whether `bytes` begin as a WebP file does.
bool IsWebp(std::string_view bytes);

/// Decodes a still WebP picture, lossy or lossless, as DecodeImage does. One colour takes no bytes for its
/// pixels, so the format's own limit of 16383 pixels along a side and `max_pixels` are the only bounds.
/// Errors: kInvalidArgument if it is damaged, truncated or animated; kResourceExhausted over `max_pixels`.
absl::StatusOr<ImageData> DecodeWebp(std::string_view bytes, int64_t max_pixels);

}  // namespace lumifold::scene
