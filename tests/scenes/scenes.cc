#include "tests/scenes/scenes.h"

#include <algorithm>

namespace lumifold::scenes {

std::span<const SceneEntry> AllScenes() {
  static constexpr SceneEntry kScenes[] = {
      {"cornell-box", "two blocks in a box with a red and a green wall; all surfaces diffuse",
       BuildCornellBox},
      {"meeting-room", "table and chairs, daylight through blinds, ceiling panels, mirror", BuildMeetingRoom},
      {"bedroom", "a bed with folded cloth, a lamp, a window, wood and wallpaper", BuildBedroom},
      {"atrium", "a court after Sponza: arches, columns, thin curtains, sun through the roof", BuildAtrium},
      {"uplighter", "a room at night, lit off the ceiling by a shaded lamp; a glass egg and metal",
       BuildUplighter},
      {"chess-board", "pieces on a chequered board, fairy lights behind; for a lens", BuildChessBoard},
      {"foliage", "bushes and grass before a bright sky; for a lens", BuildFoliage},
      {"tiny-diffuse", "a box and a ball in a room; all surfaces diffuse", BuildTinyDiffuse},
      {"tiny-mirror", "the same of perfect mirrors, lit by two walls and a lamp", BuildTinyMirror},
      {"tiny-unlit", "the same of unlit materials, without light", BuildTinyUnlit},
      {"tiny-emitter", "walls and cards that emit and reflect nothing", BuildTinyEmitter},
      {"tiny-textured", "a box and a ball in a room; all surfaces diffuse with a texture", BuildTinyTextured},
  };
  return kScenes;
}

const SceneEntry* FindScene(std::string_view name) {
  const std::span<const SceneEntry> scenes = AllScenes();
  const auto found =
      std::find_if(scenes.begin(), scenes.end(), [&](const auto& s) { return s.name == name; });
  return found == scenes.end() ? nullptr : &*found;
}

}  // namespace lumifold::scenes
