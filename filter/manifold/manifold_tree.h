#pragma once

#include <vector>

#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One manifold eta_k, sampled on the coarse grid.
struct Manifold {
  Planes eta;               // its value in each feature
  std::vector<float> axis;  // v1, the principal axis that splits its cluster in two; Eq. (6)
};

/// A cluster on the coarse grid: means over each cell's pixels of weight * u, and of the weight.
struct ClusterSums {
  Planes weighted;
  Plane weight;
};

/// Uninitialised planes.
ClusterSums MakeClusterSums(size_t features, const Lattice& lattice);

/// The manifold of a cluster: low-passed weighted features over low-passed weight, drawn to `parent` by
/// kParentMass (0 where parent is null and there is no weight). Its axis comes from `iterations` steps of
/// power iteration on the covariance of the cells around the manifold; it is empty for 0 iterations.
/// Units:   sigma_cells in cells.
/// Threads: identical for any pool.
/// Source:  Gastal & Oliveira 2012, Algorithm 1, steps 1 and 4, Eq. (7) and (8); the axis: Appendix B.
Manifold MakeManifold(ClusterSums sums, const Planes* parent, float sigma_cells, int iterations,
                      TaskPool* pool);

}  // namespace lumifold::filter
