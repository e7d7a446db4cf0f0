#pragma once

#include "tests/scenes/scene_description.h"

namespace lumifold::stability {

// Small closed rooms, 4 x 3 x 6 m, under one lamp, seen from inside.

/// A flat mirror on the rear wall shows a room with a textured floor and a picture.
scenes::SceneDescription MirrorRoom();
/// A mirroring sphere before a flat mirror.
scenes::SceneDescription MirrorSphereRoom();
/// The rear and the front wall are mirrors.
scenes::SceneDescription FacingMirrorsRoom();
/// A pane of glass over the right half of a chequered wall.
scenes::SceneDescription GlassRoom();
/// Seven panels of metal on the rear wall, from smooth to rough.
scenes::SceneDescription RoughnessRoom();
inline constexpr int kRoughnessPanels = 7;
/// A ball that is half metal, half diffuse.
scenes::SceneDescription HalfMetalRoom();
/// White corners lit by light from all around them.
scenes::SceneDescription CornerRoom();
/// No lamp: what light there is comes through a slit in the wall.
scenes::SceneDescription SlitRoom();
/// A floor with a fine chequer that runs to the far wall, 60 m off.
scenes::SceneDescription ChequeredHall();
/// A small bright lamp and a ball of brushed metal that throws its light about.
scenes::SceneDescription CausticRoom();

}  // namespace lumifold::stability
