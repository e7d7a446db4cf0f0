#pragma once

#include <vector>

#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/splat.h"

namespace lumifold::filter {

/// Gathers rows of pixels from the blurred manifolds of a level, bilinearly between cells.
/// Threads: holds scratch memory, so one object for each task.
/// Source:  Gastal & Oliveira 2012, slicing: the sums of Eq. (4).
class StripSlice {
 public:
  /// `psi`: for each manifold the blurred planes of cells, C of signals and one of the weight.
  StripSlice(const PixelState& state, const std::vector<Planes>& psi);

  /// (*sums)[c] += sum over manifolds of w * psi, in pixel row y.
  void PixelRow(int y, Planes* sums);

 private:
  const PixelState& state_;
  const std::vector<Planes>& psi_;
  size_t planes_;
  std::vector<float> cells_;  // a row of cells a manifold and plane
  std::vector<const float*> upper_, lower_, weight_rows_;
  std::vector<float*> sum_rows_;
};

}  // namespace lumifold::filter
