#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// The film's noisy picture C as halves; light a trillion times the mean counts as that, so that its square
/// is a float.
Halves NoisyHalves(const LayeredImage& film, TaskPool* pool);

/// The variance of each half, from what the two differ by, averaged over 7x7 pixels: a film holds none of
/// single samples. 0 where one half is unknown.
Planes HalfVariance(const Halves& halves, TaskPool* pool);

/// `planes`, 3 of them, in the film's unit: times scale, 0 where that is no number.
Picture FinitePicture(Planes planes, float scale);

}  // namespace lumifold::filter
