#pragma once

#include <vector>

#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/splat.h"

namespace lumifold::filter {

/// Reads rows of pixels back from the manifolds of a level. Holds scratch memory: one for each task.
class StripSlice {
 public:
  /// `psi`: a manifold's blurred planes of cells, C of signals and one of the weight.
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

/// Adds w * psi of a level's manifolds to the points' sums: values and weights, as SlicedPoints lays them
/// out.
void SlicePointsAt(const PixelState& state, const std::vector<Manifold>& manifolds,
                   const std::vector<Planes>& psi, const SlicePoints& points, TaskPool* pool,
                   SlicedPoints* sums);

}  // namespace lumifold::filter
