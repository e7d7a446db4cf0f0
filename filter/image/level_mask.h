#pragma once

#include "filter/image/layered_image.h"

namespace lumifold {

/// 1 at the pixels of a film that show a mirror or an object through glass, else 0; 0 everywhere if the film
/// has no levels (docs/layers.md).
/// Threads: safe concurrently.
Plane LevelMask(const LayeredImage& film);

}  // namespace lumifold
