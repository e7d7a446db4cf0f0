#pragma once

#include <string_view>

#include "absl/status/status.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {

/// Bytes of a block of 4x4 pixels.
constexpr int kUastcBlockBytes = 16;

/// Decodes `blocks`, row by row from the top, into the whole of `image`. Colours are interpolated as they are
/// stored, without the rounding that ASTC has for sRGB, as the reference transcoder does.
/// Errors: kInvalidArgument if the length is not that of the picture's blocks, or if a block has a mode or a
/// partition that is not defined.
/// Source: Binomial, "UASTC Texture Specification"; the Khronos Data Format Specification, "ASTC Compressed
/// Texture Image Formats".
absl::Status DecodeUastc(std::string_view blocks, ImageData* image);

}  // namespace lumifold::scene
