#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

/// The remainder: C - sum of light * factor over all products - E - E of the levels. It holds light of delta
/// chains beyond the last level, and what the split of a pixel's mean loses, since the mean of a product is
/// not the product of means. W x H, 3 planes each; unusable values count as 0.
struct Remainder {
  Planes a;  // of each half; where a half has no sample of a layer, the layer's mean stands for it
  Planes b;
  Planes mean;  // of both; RemainderProduct() makes it
};

/// All emission, of the first hit and of the levels. 3 planes.
Planes EmissionOf(const Frame& frame, TaskPool* pool);

/// `combined`, a mean of C, without all emission, of the first hit and of the levels. 3 planes.
Planes WithoutEmission(const Frame& frame, const ConstColorView& combined, TaskPool* pool);

/// The halves of C without all emission: the remainder before products are subtracted (SubtractNoisy).
Remainder WithoutEmission(const Frame& frame, TaskPool* pool);

/// The mean of two halves of planes, weighted by the pixels' sample counts.
Planes MeanOfHalves(const Frame& frame, const Planes& a, const Planes& b, TaskPool* pool);

/// Whether the remainder holds nothing but the rounding of sums: there is nothing to filter then.
bool IsRounding(const Remainder& remainder, const Frame& frame, TaskPool* pool);

/// The remainder as a product of factor 1, valid on all hits in `box` that do more than emit: of those that
/// only emit (T = 0, E > 0) the remainder is exact. `picture`: all other products filtered; its magnitude
/// weighs errors (Halves::picture_light). Keeps views of `remainder`, whose mean it makes.
Product RemainderProduct(const Frame& frame, const Rect& box, const Picture& picture,
                         const ProductParams& params, TaskPool* pool, Remainder* remainder);

}  // namespace lumifold::filter
