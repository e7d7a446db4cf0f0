#pragma once

#include <optional>
#include <string>

#include "absl/status/statusor.h"

namespace lumifold::client {

/// Width over height of what a camera of the scene file sees; nothing where neither the camera nor the scene
/// says. `camera` is as in JobSpec: a name, a number in the order of the nodes, or empty for the first; one
/// that does not exist has no aspect ratio, since a worker says which there are. Not by the worker's loader,
/// which reads all buffers first, and refuses scenes of later versions that `submit --unchecked` leaves to
/// the farm.
/// Errors: those of ReadSceneJson, with the scene's name.
absl::StatusOr<std::optional<double>> CameraAspect(const std::string& scene_path, const std::string& camera);

/// The same of a scene's JSON text; nothing where it is not glTF.
std::optional<double> CameraAspectOf(const std::string& json_text, const std::string& camera);

}  // namespace lumifold::client
