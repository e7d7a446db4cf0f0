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
  double explained_variance = 0.95;  // fewest dimensions with this share of the variance, within the limits
};

/// The NLM space: the principal axes of a picture's patches. Pixels with similar neighbourhoods are close in
/// it.
struct PatchBasis {
  int radius = 0;
  int dimensions = 0;
  /// Coefficient of axis k for channel c at offset (dx, dy): [((k * channels + c) * side + dy + radius) *
  /// side + dx + radius], side = 2 radius + 1, times the patch's window. The squares of the window sum to 1
  /// over all channels: white noise of variance s^2 in the picture has variance s^2 over all dimensions
  /// together.
  std::vector<float> kernels;
};

/// PCA of the windowed patches of `color` (any number of channels) at a fixed lattice of the pixels whose
/// mask is above 0. Axes are orthonormal, in the order of falling variance; the coefficient of largest
/// magnitude of each is positive. Without a valid pixel the window's own axes result.
/// Edges:   clamped.
/// Threads: identical for any pool.
/// Source:  Tasdizen 2009.
PatchBasis FitPatchBasis(const Planes& color, ConstFloatView mask, const PatchParams& params, TaskPool* pool);

/// Coordinates of each pixel's patch along the basis, not mean-centred (only differences matter).
/// Shapes:  result: `basis.dimensions` planes.
/// Units:   those of `color`.
/// Edges:   clamped.
/// Threads: identical for any pool.
Planes ProjectPatches(const Planes& color, const PatchBasis& basis, TaskPool* pool);

}  // namespace lumifold::filter
