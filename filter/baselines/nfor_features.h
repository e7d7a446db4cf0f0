#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The features of a regression: normal (3 planes), distance, and T (3), of the surface that the pixel shows;
/// in mirrors and behind glass, of the surface seen there. Each has mean 0 and variance about 1, or is 0
/// where it hardly varies.
struct CrossFeatures {
  Planes a;     // prefiltered half A
  Planes b;     // prefiltered half B
  Planes mean;  // of both, prefiltered again: for a pass over the combined result
};

/// Features prefiltered crosswise by non-local means, each plane by itself: half A with weights of half B and
/// the reverse (F = 3, R = 5, k = 0.5), then their mean by its own weights (F = 3, R = 2, k = 0.5).
/// A film holds features once. They are traced at the same points of every pixel, so they are free of noise
/// except on edges: there the halves are means over alternate sub-samples of the edge set, as in a
/// checkerboard, and the variance is that of the sub-samples over their number; for T, over the number of the
/// pixel's samples, whose halves are unknown and taken to be equal. Without an edge set nothing is filtered.
/// Shapes:  W x H; finite whatever the film holds.
/// Threads: identical for any pool.
/// Source:  Bitterli et al. 2016, section 5.1, with the parameters of their published program.
CrossFeatures PrefilteredFeatures(const FilmView& film, TaskPool* pool);

}  // namespace lumifold::filter
