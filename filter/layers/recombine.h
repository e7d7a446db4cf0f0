#pragma once

#include <array>
#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

/// What the products and what shines by itself leave of C: specular light beyond the last level, and what
/// means lose, the mean of a product not being the product of means. W x H, 3 planes each; not finite values
/// count as 0.
struct Remainder {
  Planes mean;  // C - sum of mean * factor - E - E of the levels
  Planes a;     // the same with the halves; a half that knows nothing of a layer takes its mean
  Planes b;
};

/// Mean of |x| over all channels; not finite values count as 0.
float MeanMagnitude(const ConstColorView& color, TaskPool* pool);

Remainder MakeRemainder(const LayeredImage& film, const std::vector<Product>& products, TaskPool* pool);

/// Whether nothing but the rounding of sums is left: there is nothing to filter then.
bool IsRounding(const Remainder& remainder, const LayeredImage& film, TaskPool* pool);

/// C plus what the filter changed, so that what it left alone passes through to the last bit: C + sum of
/// (filtered - mean) * factor. `filtered`: a product's, of its box's size, each. Not finite values count as
/// 0.
std::array<Plane, 3> Recombine(const LayeredImage& film, const std::vector<Product>& products,
                               const std::vector<Planes>& filtered, TaskPool* pool);

/// picture += after - before in the box, 3 planes each: `after` of the box's size, all else W x H. Not finite
/// values count as 0.
void AddChange(const Planes& before, const Planes& after, const Rect& box, TaskPool* pool,
               std::array<Plane, 3>* picture);

/// Draws F back towards C where the two differ by more than C's noise can explain: F + max(0, 1 - c v / r^2)
/// (C - F), v and r^2 means over a window of the variance of C's filtered part (from halves; the larger one
/// of a small window and a wide one) and of (C - F)^2, c = 4. With few samples a single pixel does not draw
/// its window back. So F converges to C with the samples. Does
/// nothing where the film has no second half.
void ShrinkResidual(const LayeredImage& film, TaskPool* pool, std::array<Plane, 3>* picture);

}  // namespace lumifold::filter
