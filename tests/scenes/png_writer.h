#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

/// The bytes of an 8-bit sRGB PNG file.
/// Errors: kInvalidArgument if the pixels do not fit the size; kInternal with libpng's message.
absl::StatusOr<std::string> EncodePng(const Texture& texture);

}  // namespace lumifold::scenes
