#pragma once

#include <vector>

#include "filter/image/planes.h"
#include "filter/kernels/row_kernels.h"
#include "filter/manifold/lattice.h"

namespace lumifold::filter {

/// Gathers rows of pixels from the blurred manifolds of a level, bilinearly between cells.
/// Threads: holds scratch memory, so one object for each task.
/// Source:  Gastal & Oliveira 2012, slicing: the sums of Eq. (4).
class StripSlice {
 public:
  /// `psi`: for each manifold the blurred planes of cells, C of signals and one of the weight.
  /// `weights`: of the pixels, for each manifold. Rows of pixels are ordered by phase.
  StripSlice(const Planes& weights, const std::vector<Planes>& psi, const Lattice& lattice,
             const Phases& phases);

  /// (*sums)[c] = sum over manifolds of w * psi, in pixel row y; += if `adds`.
  void PixelRow(int y, bool adds, Planes* sums);

 private:
  const Planes& weights_;
  const std::vector<Planes>& psi_;
  const Lattice& lattice_;
  const Phases& phases_;
  size_t planes_;
  std::vector<float> cells_;  // a row of cells a manifold and plane
  std::vector<const float*> upper_, lower_, weight_rows_;
  std::vector<float*> sum_rows_;
};

}  // namespace lumifold::filter
