#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Reads light `source` of KHR_lights_punctual, placed at the origin. Colours and cones out of range are
/// clamped and counted under `place`. Errors: kInvalidArgument naming `place`, for an unknown type and values
/// that are not finite.
absl::StatusOr<PunctualLight> ReadLight(const tinygltf::Light& source, const std::string& place,
                                        Diagnostics* diagnostics);

}  // namespace lumifold::scene
