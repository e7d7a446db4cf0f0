#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

struct PatchParams {
  int radius = 3;  // patches of (2 radius + 1)^2 pixels, >= 1
  int least_dimensions = 3;
  int most_dimensions = 6;
  double explained_variance = 0.95;  // as many dimensions as reach this share, within the two limits
};

/// The principal axes of a picture's patches: the NLM space, in which near means alike in a whole
/// neighbourhood.
struct PatchBasis {
  int radius = 0;
  int dimensions = 0;
  /// Axis k's factor for channel c at offset (dx, dy): [((k * channels + c) * side + dy + radius) * side + dx
  /// + radius], side = 2 radius + 1; the patch's window is in it. The squares of the window, over all
  /// channels, sum to 1: white noise of variance s^2 in the picture moves a patch by s^2 in all dimensions
  /// together.
  std::vector<float> kernels;
};

/// PCA of the windowed patches of `color` (any number of channels), over a fixed lattice of the pixels whose
/// mask is over 0. Axes are orthonormal, longest first, the entry of largest magnitude of each positive. No
/// valid pixel gives the window's own axes. Edges: clamped. Threads: identical for any pool. Source: Tasdizen
/// 2009.
PatchBasis FitPatchBasis(const Planes& color, ConstFloatView mask, const PatchParams& params, TaskPool* pool);

/// Coordinates of each pixel's patch along the basis: `basis.dimensions` planes, in the unit of `color`, not
/// mean-centred (only differences matter). Edges: clamped. Threads: identical for any pool.
Planes ProjectPatches(const Planes& color, const PatchBasis& basis, TaskPool* pool);

}  // namespace lumifold::filter
