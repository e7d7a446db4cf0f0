#pragma once

#include <vector>

#include "filter/kernels/row_kernels.h"
#include "filter/manifold/manifold_tree.h"

namespace lumifold::filter {

/// Per-pixel data at full resolution: the filter's input, and what is kept from level to level of the tree.
struct PixelState {
  const Planes& signals;
  const Planes& features;
  Plane mask;  // of splats
  Lattice lattice;
  Widening widening;
  Plane members;      // mask times the pixel's membership in its cluster, 0 to 1
  Plane labels;       // manifold of the current level whose cluster the pixel belongs to
  Plane next_labels;  // the same of the next level
  Planes weights;     // for each manifold of the current level: w_ki, the pixel's weight on it
};

/// All manifolds of one level of the tree. The children of manifold i are 2i and 2i + 1 of the next level.
struct Level {
  std::vector<Manifold> manifolds;
  std::vector<Planes> splats;  // for each manifold, per cell: mean of mask * w * f (C planes), of mask * w
  std::vector<ClusterSums> children;  // of the next level's clusters; empty at the last level
};

/// Splats pixels onto the manifolds of a level, one row of cells at a time, in strips that stay in the cache;
/// also splits each cluster by its axis and sums its children.
/// Threads: holds scratch memory, so one object for each task; rows of cells are independent.
/// Source:  Gastal & Oliveira 2012, splatting, Eq. (3) and (5), with box means onto cells; the clusters, Eq.
///          (6).
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

/// Means of member * feature and of member over each cell of one row: the cluster of the root, which has all
/// pixels.
void RootCellRow(const PixelState& state, int row, ClusterSums* sums);

}  // namespace lumifold::filter
