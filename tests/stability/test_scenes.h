#pragma once

#include "tests/scenes/scene_description.h"

namespace lumifold::stability {

// Small closed rooms, 4 x 3 x 6 m, with one lamp, seen from inside.

/// A flat mirror on the rear wall shows a room with a textured floor and a picture.
scenes::SceneDescription MirrorRoom();
/// A mirror sphere in front of a flat mirror.
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
/// White corners in indirect light.
scenes::SceneDescription CornerRoom();
/// No lamp: all light comes through a slit in the wall.
scenes::SceneDescription SlitRoom();
/// A floor with a fine chequer pattern up to the far wall, at 60 m.
scenes::SceneDescription ChequeredHall();
/// A small bright lamp and a ball of brushed metal that casts caustics.
scenes::SceneDescription CausticRoom();

}  // namespace lumifold::stability
