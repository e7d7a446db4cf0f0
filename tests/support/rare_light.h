#pragma once

#include "worker/scene/scene.h"

/// Small scenes with light that few paths find.
namespace lumifold::testing {

/// A grey box, seen from inside, with a small bright lamp and a ball that throws its light onto the floor.
scene::Scene CausticRoom(const scene::Material& ball);

/// The same box, divided by a wall with a square hole of `hole` metres before the camera; the lamp is behind
/// it. Of `rear` are the walls behind the wall.
scene::Scene KeyholeRoom(float hole, const scene::Material& rear);

}  // namespace lumifold::testing
