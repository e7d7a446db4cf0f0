#pragma once

#include <array>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

struct ManifoldParams {
  float sigma_s = 16;      // reach in pixels, > 0
  int height = 4;          // levels of the tree, 1..8: 2^height - 1 manifolds
  int pca_iterations = 3;  // >= 1: steps of power iteration for the axis that splits a cluster
  int cell = 0;  // side of a coarse cell in pixels: a power of two up to kBandRows; 0: CellSize(sigma_s)
  /// Pixels and points whose weights on all manifolds sum to less than 1 splat more, so that they give all
  /// their mass. As published, they give less the farther they are from all manifolds, and pixels nearer to
  /// these decide what they get.
  bool keeps_mass = false;
  bool is_first_order = false;  // fits planes to the signals, of which there are 3 (first_order.h)
  /// Added to the variances of positions, in reaches, so that slopes that few pixels support stay small.
  float slope_ridge = 6e-3f;
};

/// Side of a coarse cell for a reach, in pixels: 2^floor(log2(sigma_s / 4)), from 2 (1 for sigma_s below 2)
/// to kBandRows. Cells of one pixel would double the cost for 2 % less error.
int CellSize(float sigma_s);
/// Side of a coarse cell with these parameters.
inline int CellOf(const ManifoldParams& params) {
  return params.cell > 0 ? params.cell : CellSize(params.sigma_s);
}

/// Filters `signals` with adaptive manifolds through the space spanned by `features`:
///   out = sum_k w_k up(Psi_k) / sum_k w_k up(Psi0_k), w_k = exp(-|u - up(eta_k)|^2),
/// where Psi_k is the signal splatted with w_k (if keeps_mass, w_k / min(1, sum_j w_j)) onto manifold k's
/// coarse cells and blurred along the manifold.
/// Shapes:  signals: C planes, features: d planes (>= 1), mask: all W x H. Result: C planes, W x H.
/// Units:   features are divided by their range sigmas beforehand, so that 1 is one sigma; the signal's unit
///          does not matter.
/// Mask:    weight >= 0 of a pixel in splats, clusters and blurs. A pixel of weight 0 contributes nothing;
///          its result is what its features find on the manifolds, or its own signal where they find nothing.
///          Signals and features must be finite everywhere, also where the mask is 0.
/// Edges:   clamped.
/// Threads: safe concurrently; the result is identical for any pool, null included, and any instruction set.
/// Source:  Gastal & Oliveira 2012, Algorithm 1 and Eq. (4), without the outliers' adjustment of Eq. (10);
///          box-mean downsampling, deterministic clusters and all recursion on coarse grids
///          (docs/decisions/0006-filter-deviations.md).
Planes ManifoldFilter(const Planes& signals, const Planes& features, ConstFloatView mask,
                      const ManifoldParams& params, TaskPool* pool);

/// Points in feature space that belong to no pixel centre: sub-samples of edge pixels, or the surfaces that
/// an edge pixel shows. The filter is read at them; points with signals are filtered like pixels.
struct SlicePoints {
  std::vector<std::array<int, 2>> pixels;  // x, y of each point's pixel; a pixel may have many points
  /// The last features of each point, in units of the filter's features: feature k of point i is at
  /// [i * own_features + k]. The first d - own_features features are the pixel's.
  size_t own_features = 0;
  std::vector<float> features;
  /// Divisor of the squared distance over the pixel's features, whose patch on an edge mixes surfaces.
  float pixel_divisor = 16;
  /// Signals of the points, with which they are splatted in their pixels' cells beside the pixels: channel c
  /// of point i is at [i * C + c]. Empty: points are read only.
  std::vector<float> signals;
  /// Weights of the points in splats, >= 0, beside the mask of the pixels. A pixel whose points have weight
  /// is not splatted itself.
  std::vector<float> weights;
};

/// The filter's result at points.
struct SlicedPoints {
  std::vector<float> values;  // channel c of point i at [i * C + c]
  /// Sum over manifolds of w * up(Psi0) of each point; 0 where it found nothing; its values are then 0.
  std::vector<float> weights;
};

/// Result of one run of the filter.
struct ManifoldResult {
  Planes filtered;
  SlicedPoints points;  // empty where none were asked for
};

/// ManifoldFilter with a blur of its own and with points. Manifolds and splats are those of params.sigma_s;
/// the blur along the manifolds has sigma `reach` (pixels, > 0). With reach = params.sigma_s, `filtered` is
/// ManifoldFilter's. `points`, which may be null, are read from the same manifolds without another blur;
/// those with signals are also splatted on them. The clusters are those of the pixels alone.
/// Threads: as ManifoldFilter's; the device of the pool, if it has one, does the work (filter_device.h).
/// Source: the points are those of Gruzdev et al. 2015, antialiasing.
ManifoldResult ManifoldFilterAtPoints(const Planes& signals, const Planes& features, ConstFloatView mask,
                                      const ManifoldParams& params, float reach, const SlicePoints* points,
                                      TaskPool* pool);

}  // namespace lumifold::filter
