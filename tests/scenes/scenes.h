#pragma once

#include <span>
#include <string_view>

#include "tests/scenes/scene_description.h"

namespace lumifold::scenes {

// Each scene is built from code alone and is the same on every call. Exposed for a picture at exposure 1;
// 4:3, metres, +Y up. Threads: safe concurrently.

/// The four scenes of the paper's tables, lit by emissive triangles only.
SceneDescription BuildCornellBox();
SceneDescription BuildMeetingRoom();
SceneDescription BuildBedroom();
SceneDescription BuildAtrium();

/// Hard light: all of it is indirect, off one bright spot on the ceiling.
SceneDescription BuildUplighter();

/// For a lens: out of focus are fine texture, thin edges and small bright lamps.
SceneDescription BuildChessBoard();
SceneDescription BuildFoliage();

/// Tiny scenes that need one part of the model each: see docs/plan.md.
SceneDescription BuildTinyDiffuse();
SceneDescription BuildTinyMirror();
SceneDescription BuildTinyUnlit();
SceneDescription BuildTinyEmitter();
SceneDescription BuildTinyTextured();

struct SceneEntry {
  std::string_view name;  ///< also the file's name, without ".glb"
  std::string_view summary;
  SceneDescription (*build)();
};

/// The table behind `lumifold-scenes --list`: first those of the paper, in its order.
std::span<const SceneEntry> AllScenes();

/// Null if there is no scene of that name.
const SceneEntry* FindScene(std::string_view name);

}  // namespace lumifold::scenes
