#pragma once

#include <vector>

#include "filter/kernels/row_kernels.h"
#include "filter/manifold/manifold_tree.h"

namespace lumifold::filter {

/// What pixels bring to the manifolds and what they keep from level to level, at full resolution.
struct PixelState {
  const Planes& signals;
  const Planes& features;
  Plane mask;
  Lattice lattice;
  Widening widening;
  Plane members;      // mask times how far the pixel belongs to its cluster
  Plane labels;       // the manifold of the present level whose cluster the pixel belongs to
  Plane next_labels;  // the same of the next level
  Planes weights;     // a manifold of the present level: the pixel's weight on it
};

/// All manifolds of one level. Manifold i's children are 2i and 2i + 1 of the next level.
struct Level {
  std::vector<Manifold> manifolds;
  std::vector<Planes>
      splats;  // a manifold: C planes of cells with the mean of mask * w * f, one with that of mask * w
  std::vector<ClusterSums> children;  // of the next level's clusters; empty at the last level
};

/// Splats pixels onto the manifolds of a level, a row of cells at a time, in strips that stay in the cache.
/// Holds scratch memory: one for each task. Rows of cells are independent of each other.
class StripSplat {
 public:
  StripSplat(PixelState* state, Level* level);

  void CellRow(int row);

 private:
  /// Strips a power of two apart would share a few sets of the cache, and drive each other out.
  static constexpr size_t kSumStride = kStripColumns + kRowPadding;

  void Strip(size_t manifold, int row, int x0);
  SplatFound PixelRow(size_t manifold, int y, int x0, int count);
  float* Sums(size_t i) { return sums_.data() + i * kSumStride; }

  PixelState& state_;
  Level& level_;
  std::vector<float> sums_;  // strips: C + 1 of signals, then d + 1 of each of two children
  std::vector<float*> sum_rows_;
  std::vector<float> eta_;  // a row of cells a feature
  std::vector<const float*> upper_, lower_, feature_rows_, signal_rows_;
};

/// Sums of mask * feature and of mask over each cell, as means: the root's cluster. One row of cells.
void RootCellRow(const PixelState& state, int row, ClusterSums* sums);

}  // namespace lumifold::filter
