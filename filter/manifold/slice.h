#pragma once

#include <vector>

#include "filter/image/planes.h"
#include "filter/kernels/row_kernels.h"
#include "filter/manifold/lattice.h"
#include "filter/manifold/sites.h"

namespace lumifold::filter {

/// Gathers rows of sites from the blurred manifolds of a level, bilinearly between cells.
/// Threads: holds scratch memory, so one object for each task.
/// Source:  Gastal & Oliveira 2012, slicing: the sums of Eq. (4).
class StripSlice {
 public:
  /// `psi`: for each manifold the blurred planes of cells, C of signals and one of the weight.
  /// `weights`: of the sites, for each manifold.
  StripSlice(const Planes& weights, const std::vector<Planes>& psi, const Lattice& lattice,
             const Phases& phases, const Sites& sites);

  /// (*sums)[c] = sum over manifolds of w * psi, in pixel row y and at its points; += if `adds`.
  void PixelRow(int y, bool adds, Planes* sums);

 private:
  /// Sites from x on in a row of sites; cells_ holds what they read.
  SliceArgs Args(int row, int x, bool adds, Planes* sums);

  const Planes& weights_;
  const std::vector<Planes>& psi_;
  const Lattice& lattice_;
  const Phases& phases_;
  const Sites& sites_;
  size_t planes_;
  std::vector<float> cells_;  // a row of cells a manifold and plane
  std::vector<const float*> upper_, lower_, weight_rows_;
  std::vector<float*> sum_rows_;
};

}  // namespace lumifold::filter
