#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

/// The bytes of a binary glTF 2.0 file with its textures inside and one camera named "camera".
/// Numbers are rounded to a grid far coarser than a libm's error, so that every machine writes the same
/// bytes.
/// Errors: kInvalidArgument, naming the part, for an id or index out of range or arrays of different length.
absl::StatusOr<std::string> EncodeGlb(const SceneDescription& scene);

/// Writes `bytes` to `path` atomically, through a temporary file in the same folder.
absl::Status WriteFile(const std::string& path, const std::string& bytes);

}  // namespace lumifold::scenes
