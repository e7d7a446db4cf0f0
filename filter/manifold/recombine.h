#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/manifold/bands.h"

namespace lumifold::filter {

/// What D, I, T and E do not explain: R plus what their means lose, the mean of a product not being the
/// product of means. W x H, 3 planes each; not finite values count as 0.
struct Remainder {
  Planes mean;  // C - (D + I) T - E
  Planes a;     // the same with the halves of C, D and I
  Planes b;
};

Remainder MakeRemainder(const LayeredImage& film, TaskPool* pool);

/// The three filtered layers of a film, in its unit.
struct FilteredLayers {
  Planes direct;
  Planes indirect;
  Planes remainder;
};

/// F = (D + I) * T + remainder + E, written as C plus what the filter changed, so that what it left alone
/// passes through to the last bit. Not finite values count as 0.
std::array<Plane, 3> Recombine(const LayeredImage& film, const Remainder& before,
                               const FilteredLayers& filtered, TaskPool* pool);

/// Draws F back towards C where the two differ by more than C's noise can explain: F + max(0, 1 - c v / r^2)
/// (C - F), v and r^2 means over a window of the variance of C's filtered part (from halves) and of (C -
/// F)^2, c = 4. So F converges to C with the samples. Does nothing where the film has no second half.
void ShrinkResidual(const LayeredImage& film, TaskPool* pool, std::array<Plane, 3>* picture);

}  // namespace lumifold::filter
