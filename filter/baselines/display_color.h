#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The film's noisy picture C in displayed values, 3 planes in [0, 1]: the sRGB curve, clamped at 1. Filters
/// of finished pictures work on such values; the clamp removes most of the energy of fireflies.
Planes DisplayColor(const LayeredImage& film, TaskPool* pool);

/// The inverse: displayed values to linear light.
Picture LinearColor(const Planes& display, TaskPool* pool);

}  // namespace lumifold::filter
