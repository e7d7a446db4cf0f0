#pragma once

#include <cstdint>

#include "tests/scenes/geometry.h"

namespace lumifold::scenes {

/// An even-handed number in [0, 1) for a lattice point; the same on every machine.
double HashNoise(int x, int y, unsigned seed);

/// Smooth noise in [0, 1], one feature a unit. With `period` > 0 it repeats after that many units.
double ValueNoise(Vec2 p, unsigned seed, Vec2 period = {});

/// `octaves` of value noise, each half the size and strength of the one before; in [0, 1].
double Fbm(Vec2 p, int octaves, unsigned seed, Vec2 period = {});

}  // namespace lumifold::scenes
