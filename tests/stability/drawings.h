#pragma once

#include "tests/stability/drawn_film.h"

namespace lumifold::stability {

/// A room with many features: sky, a wall under light that falls off, a tilted box, a floor of textured tiles
/// with a hard and a soft shadow, a thin pole, a small lamp. `shift` moves the camera to the right, in pixels
/// of the wall; nearer objects move faster (parallax).
Drawing RoomDrawing(int width, int height, float shift = 0);

/// A flat wall and a floor without textures.
Drawing FlatRoomDrawing(int width, int height);

}  // namespace lumifold::stability
