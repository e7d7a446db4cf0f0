#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The film's noisy picture C as a display shows it, 3 planes in [0, 1]: sRGB's curve, what is brighter than
/// 1 cut. Filters of finished pictures work on this; it takes most of fireflies, as it does there.
Planes DisplayColor(const LayeredImage& film, TaskPool* pool);

/// Back to linear light.
Picture LinearColor(const Planes& display, TaskPool* pool);

}  // namespace lumifold::filter
