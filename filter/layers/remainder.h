#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

/// The remainder: C - sum of mean * factor over all products - E - E of the levels. It holds light of delta
/// chains beyond the last level, and what the split of a pixel's mean loses, since the mean of a product is
/// not the product of means. W x H, 3 planes each; unusable values count as 0.
struct Remainder {
  Planes mean;
  Planes a;  // the same of each half; where a half has no sample of a layer, the layer's mean stands for it
  Planes b;
};

/// `combined`, a mean of C, without all emission, of the first hit and of the levels. 3 planes.
Planes WithoutEmission(const Frame& frame, const ConstColorView& combined, TaskPool* pool);

/// out -= value * factor. Where `count`, if not null, is 0, `mean` stands for the value.
void SubtractProduct(const ConstColorView& value, const ConstColorView& factor, const ConstFloatView* count,
                     const ConstColorView& mean, TaskPool* pool, Planes* out);

Remainder MakeRemainder(const Frame& frame, const std::vector<Product>& products, TaskPool* pool);

/// Whether the remainder holds nothing but the rounding of sums: there is nothing to filter then.
bool IsRounding(const Remainder& remainder, const Frame& frame, TaskPool* pool);

/// The remainder as a product of factor 1, valid on all hits in `box` that do more than emit: of those that
/// only emit (T = 0, E > 0) the remainder is exact. `picture`: all other products filtered; its magnitude
/// weighs errors (Halves::picture_light). Keeps views of `remainder`.
Product RemainderProduct(const Frame& frame, const Remainder& remainder, const Rect& box,
                         const Picture& picture, const ProductParams& params, TaskPool* pool);

}  // namespace lumifold::filter
