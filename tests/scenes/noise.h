#pragma once

#include <cstdint>

#include "tests/scenes/geometry.h"

namespace lumifold::scenes {

/// A uniformly distributed number in [0, 1) for a lattice point; the same on every machine.
double HashNoise(int x, int y, unsigned seed);

/// Smooth value noise in [0, 1], one feature per unit. With `period` > 0 it repeats after that many units.
double ValueNoise(Vec2 p, unsigned seed, Vec2 period = {});

/// The sum of `octaves` of value noise, each with half the size and amplitude of the one before; in [0, 1].
double Fbm(Vec2 p, int octaves, unsigned seed, Vec2 period = {});

}  // namespace lumifold::scenes
