#pragma once

#include "tests/stability/drawn_film.h"

namespace lumifold::stability {

/// Something of everything: sky, a wall under light that falls off, a tilted box, a floor of textured tiles
/// with a hard and a soft shadow, a thin pole, a small lamp. `shift` moves the camera to the right, in pixels
/// of the wall: what is nearer moves faster.
Drawing RoomDrawing(int width, int height, float shift = 0);

/// The same without textures: a flat wall and a floor.
Drawing FlatRoomDrawing(int width, int height);

}  // namespace lumifold::stability
