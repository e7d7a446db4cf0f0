#pragma once

#include <cstdint>
#include <string_view>

#include "absl/status/statusor.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Decodes PNG (any kind), JPEG (grey or colour), WebP or KTX2 (ETC1S, UASTC), recognised by content, to RGBA
/// exactly as stored, 16-bit PNG to 16 bits and all others to 8: colour profiles and gamma are ignored, as
/// glTF requires. The size is checked before memory is allocated. Errors: kInvalidArgument if the bytes are
/// no such image, damaged, truncated, or too few for the claimed size; kResourceExhausted over `max_pixels`.
absl::StatusOr<ImageData> DecodeImage(std::string_view bytes, int64_t max_pixels);

}  // namespace lumifold::scene
