#pragma once

#include <cstdint>

#include "filter/image/layered_image.h"

namespace lumifold::filter {

/// A film whose truth is known: sky above, a wall with a box before it, a floor with a checker albedo and a
/// hard shadow, light that falls off smoothly. Noise multiplies D and I of each half by independent factors
/// of mean 1 and relative deviation `noise` * sqrt(2), so that the mean of the halves has relative deviation
/// `noise`.
struct SyntheticFilm {
  LayeredImage film;
  LayeredImage truth;  // R G B, and direct.*
};

SyntheticFilm MakeSyntheticFilm(int width, int height, float noise, uint32_t seed);

/// Multiplies all radiance of a film (C, D, I, R, E, and halves) by `factor`.
void ScaleRadiance(float factor, LayeredImage* film);

}  // namespace lumifold::filter
