#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/manifold/bands.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {

/// The geometry part of the feature vector u: n / 0.3 (3 planes) and ln(z) / 0.05 (1 plane); 0 where
/// `validity` is 0.
Planes GeometryFeatures(const LayeredImage& film, ConstFloatView validity, TaskPool* pool);

/// asinh(x / knee) - asinh(origin / knee), plane by plane: near linear where noise is additive, logarithmic
/// where it grows with the signal, so that one range sigma suits dark and bright. knee > 0 and origin, a
/// value in the midst of the picture's, in the unit of the planes: sums of small numbers round less.
Planes Stabilise(const Planes& color, float knee, float origin, TaskPool* pool);

/// u = [NLM coordinates of `color` / sigma_q | geometry].
Planes JointFeatures(const Planes& color, const PatchBasis& basis, float sigma_q, const Planes& geometry,
                     TaskPool* pool);

}  // namespace lumifold::filter
