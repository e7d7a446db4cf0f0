#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/kernels/row_kernels.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/manifold/sites.h"

namespace lumifold::filter {

/// Which clusters the pixels belong to, from level to level of the tree, and what the weights of sites sum
/// to. Planes are of sites here and below.
struct Clusters {
  Clusters(const Plane& mask, TaskPool* pool);

  Plane members;      // mask times the pixel's membership in its cluster, 0 to 1
  Plane labels;       // manifold of the current level whose cluster the pixel belongs to
  Plane next_labels;  // the same of the next level
  Plane total;        // sum of the site's weights on the manifolds so far
};

/// All manifolds of one level of the tree. The children of manifold i are 2i and 2i + 1 of the next level.
struct Level {
  std::vector<Manifold> manifolds;
  Planes weights;                     // for each manifold: w_ki of the sites
  std::vector<ClusterSums> children;  // of the next level's clusters; empty at the last level
};

/// Weighs sites on the manifolds of a level, one row of cells at a time, in strips that stay in the cache;
/// also splits each cluster by its axis and sums its children, unless the level has none.
/// Threads: holds scratch memory, so one object for each task; rows of cells are independent.
/// Source:  Gastal & Oliveira 2012, Eq. (3), (5) and (6), with box means onto cells.
class StripWeigh {
 public:
  /// `points`: null if there are none.
  StripWeigh(const Planes& features, const Lattice& lattice, const Phases& phases, const Sites& sites,
             const SlicePoints* points, Clusters* clusters, Level* level);

  void CellRow(int row);

 private:
  /// Strips of sums of a child: d features, then the weight.
  float* const* SumsOf(size_t child) const { return sum_rows_.data() + child * (features_.size() + 1); }
  void StoreSums(size_t child, bool has_members, int row, int column);
  /// Whether the manifold's cluster has pixels there.
  bool PixelRow(size_t manifold, int y, int column);
  /// The points of row y of pixels, from the row of cells in eta_.
  void PointRow(size_t manifold, int y, int column);

  const Planes& features_;
  const Lattice& lattice_;
  const Phases& phases_;
  const Sites& sites_;
  const SlicePoints* points_;
  Clusters& clusters_;
  Level& level_;
  std::vector<float> sums_;  // strips: d + 1 of each child; 0 between cells' rows
  std::vector<float*> sum_rows_;
  std::vector<float> eta_;  // a row of cells a feature
  std::vector<const float*> upper_, lower_, feature_rows_;
};

/// Means of member * feature and of member over each cell of one row: the cluster of the root, which has all
/// pixels.
void RootCellRow(const Planes& features, const Lattice& lattice, const Clusters& clusters, int row,
                 ClusterSums* cell_means);

}  // namespace lumifold::filter
