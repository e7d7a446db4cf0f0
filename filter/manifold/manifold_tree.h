#pragma once

#include <vector>

#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One manifold, on the coarse grid.
struct Manifold {
  Planes eta;               // its height in each feature
  std::vector<float> axis;  // the direction that splits its cluster in two
};

/// What a cluster leaves on the coarse grid: mean over each cell's pixels of weight * u, and of the weight.
struct ClusterSums {
  Planes weighted;
  Plane weight;
};

/// Planes to be written: their values are anything.
ClusterSums MakeClusterSums(size_t features, const Lattice& lattice);

/// The manifold through a cluster: low-passed weighted features over low-passed weight; `parent`'s height
/// where there is no weight (0 when parent is null). Its axis: `iterations` steps of power iteration on the
/// cells' covariance about the manifold; left empty for 0. Threads: identical for any pool.
Manifold MakeManifold(ClusterSums sums, const Planes* parent, float sigma_cells, int iterations,
                      TaskPool* pool);

}  // namespace lumifold::filter
