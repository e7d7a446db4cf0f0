#pragma once

#include <span>
#include <string_view>

#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

/// The four scenes of the paper's tables. Each is built from code alone and is the same on every call.
/// Lit by emissive triangles only, exposed for a picture at exposure 1; 4:3, metres, +Y up.
/// Threads: safe concurrently.
SceneDescription BuildCornellBox();
SceneDescription BuildMeetingRoom();
SceneDescription BuildBedroom();
SceneDescription BuildAtrium();

struct SceneEntry {
  std::string_view name;  ///< also the file's name, without ".glb"
  std::string_view summary;
  SceneDescription (*build)();
};

/// The table behind `lumifold-scenes --list`, in the paper's order.
std::span<const SceneEntry> AllScenes();

/// Null if there is no scene of that name.
const SceneEntry* FindScene(std::string_view name);

}  // namespace lumifold::scenes
