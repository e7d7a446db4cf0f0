#pragma once

#include "filter/image/layered_image.h"

namespace lumifold {

/// 1 at the pixels of a film that show a mirror or something through glass, 0 elsewhere and where the film
/// has no levels (docs/layers.md). Threads: safe concurrently.
Plane LevelMask(const LayeredImage& film);

}  // namespace lumifold
