#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// What TrustIn() takes for granted.
struct TrustParams {
  int radius = 4;            // of the window that errors are averaged over
  float noise_left = 0.05f;  // variance of the picture that the values compete with, over that of C
};

/// How far values that all but lack noise are to be believed where `mask` is above 0: v / (v + bias^2) with v
/// what noise is left in the picture without them and bias^2 what (values - C)^2 has over C's variance, both
/// averaged over the pixels of the mask near by, relative to the light (ErrorWeight). `values`: W x H, 3
/// planes; may hold what is not finite, and then so may the trust about it. Threads: identical for any pool.
Plane TrustIn(const Planes& values, const Plane& mask, const LayeredImage& film, const TrustParams& params,
              TaskPool* pool);

}  // namespace lumifold::filter
