#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// What TrustIn() assumes.
struct TrustParams {
  int radius = 4;  // px: window over which errors are averaged
  /// Variance of the picture that the values compete with, over the variance of C.
  float competing_variance = 0.05f;
};

/// How far nearly noise-free values are to be followed where `mask` is above 0: v / (v + bias^2). v is the
/// variance of the picture that they compete with, bias^2 the excess of (values - C)^2 over C's variance;
/// both are averaged over the pixels of the mask in a window and weighted by ErrorWeight().
/// Shapes:  values: W x H, 3 planes; mask, result: W x H. Values may be not finite; the trust around them
///          then is, too.
/// Threads: identical for any pool.
Plane TrustIn(const Planes& values, const Plane& mask, const Frame& frame, const TrustParams& params,
              TaskPool* pool);

/// picture += share * (values - picture) where the share is above 0 and the value is finite.
void Follow(const Planes& values, const Plane& share, TaskPool* pool, Picture* picture);

}  // namespace lumifold::filter
