#pragma once

#include <cstddef>
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

/// The patches whose covariance is taken: a fixed lattice of the pixels.
struct PatchLattice {
  PatchLattice(int width, int height, size_t channels, int radius);

  /// Groups of kLatticeRows rows, whose products are summed apart.
  size_t Parts() const { return (rows.size() + kLatticeRows - 1) / kLatticeRows; }

  static constexpr size_t kLatticeRows = 8;

  int radius;
  std::vector<float> window;  // of each tap
  size_t dimensions;          // of a patch: taps of all channels
  std::vector<int> columns, rows;
};

/// Sums of products of the dimensions of patches, of which a 1 is the last: entry j of row i, j <= i, at
/// sums[i * (i + 1) / 2 + j].
struct PatchProducts {
  explicit PatchProducts(size_t of) : dimensions(of), sums((of + 1) * (of + 2) / 2) {}

  size_t dimensions;  // without the 1
  std::vector<double> sums;
};

/// Those of the patches whose pixel has a mask above 0. In float within a part, patch after patch, and in
/// double over the parts.
/// Threads: identical for any pool.
PatchProducts PatchProductsOf(const Planes& color, ConstFloatView mask, const PatchLattice& lattice,
                              TaskPool* pool);

/// The principal axes of the products, by a fixed number of orthogonal iterations.
PatchBasis BasisOf(const PatchProducts& products, const PatchLattice& lattice, const PatchParams& params);

/// PCA of the windowed patches of `color` (any number of channels) at a fixed lattice of the pixels whose
/// mask is above 0. Axes are orthonormal, in the order of falling variance; the coefficient of largest
/// magnitude of each is positive. Without a valid pixel any axes result.
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
