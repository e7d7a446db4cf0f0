#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// The film's noisy picture C as halves. Light is clamped to a trillion times the mean, so that its square is
/// a float.
Halves NoisyHalves(const LayeredImage& film, TaskPool* pool);

/// The variance of each half, (A - B)^2 / 2 averaged over 5x5 pixels, as if both had equal sample counts: a
/// film holds no variance of single samples. Of windows of 3 to 21 pixels, and of non-local means in their
/// place, 5x5 gave NFOR the least error. 0 where one half is unknown.
Planes HalfVariance(const Halves& halves, TaskPool* pool);

/// The first 3 of `planes` times `scale`; values that are not finite become 0.
Picture FinitePicture(Planes planes, float scale);

}  // namespace lumifold::filter
