#pragma once

#include <vector>

#include "filter/image/planes.h"
#include "filter/kernels/row_kernels.h"
#include "filter/manifold/lattice.h"
#include "filter/manifold/sites.h"

namespace lumifold::filter {

/// Splats sites onto manifolds, one row of cells at a time, in strips that stay in the cache.
/// Threads: holds scratch memory, so one object for each task; rows of cells are independent.
/// Source:  Gastal & Oliveira 2012, splatting, Eq. (3), with box means onto cells.
class StripSplat {
 public:
  /// `weights`: of the sites, for each manifold. `splats`: for each manifold, per cell: sum of mask * w * f
  /// of each signal, and of mask * w, over the cell's area.
  StripSplat(const Planes& signals, const Plane& mask, const Planes& weights, const Lattice& lattice,
             const Sites& sites, std::vector<Planes>* splats);

  void CellRow(int row);

 private:
  /// Strips of sums of a manifold: the signals, then the weights.
  float* const* SumsOf(size_t manifold) const { return sum_rows_.data() + manifold * (signals_.size() + 1); }
  void StoreSums(size_t manifold, bool has_weight, int row, int column);
  /// The sites from x on in a row of sites: pixels of `count` cells, or points.
  SplatArgs Args(size_t manifold, int row, int x, int count);

  const Planes& signals_;
  const Plane& mask_;
  const Planes& weights_;
  const Lattice& lattice_;
  const Sites& sites_;
  std::vector<Planes>& splats_;
  std::vector<float> sums_;  // strips of each manifold; 0 between cells' rows
  std::vector<float*> sum_rows_;
  std::vector<const float*> signal_rows_;
};

}  // namespace lumifold::filter
