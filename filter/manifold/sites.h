#pragma once

#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/types/span.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/kernels/row_kernels.h"
#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// Points of one row of pixels and one strip of it, which follow each other in a row of sites.
struct PointRun {
  int row;
  int x;  // of the first, a multiple of kRowPadding
  int count;
};

/// The sites that a filtering reads and splats: the rows of pixels, ordered by phase, and below them rows of
/// points, ordered by row of pixels and strip. A plane of sites has a value for each; what is done to each
/// site alone is one loop over all rows. Only the cells are found in two ways: those of pixels follow each
/// other, those of points are listed.
/// Threads: const calls are safe concurrently.
class Sites {
 public:
  /// Refers to both; `points` may be null.
  Sites(const Lattice& lattice, const SlicePoints* points);

  int Width() const { return lattice_.PhasedWidth(); }
  int Rows() const { return lattice_.height + point_rows_; }
  size_t PointCount() const { return places_.size(); }
  /// A plane of sites: `pixels`, and value(i) for each point; 0 for the rest.
  Plane PlaneOf(ConstFloatView pixels, absl::FunctionRef<float(size_t)> value, TaskPool* pool) const;
  /// The value of point i.
  float& At(size_t i, Plane* plane) const { return plane->At(places_[i].x, places_[i].row); }
  float At(size_t i, const Plane& plane) const { return plane.At(places_[i].x, places_[i].row); }

  /// The points of row y of pixels in the strip that begins with cell `column`.
  absl::Span<const PointRun> RunsOf(int y, int column) const;
  PointCells CellsOf(const PointRun& run) const;

 private:
  struct Place {
    int row;
    int x;
  };
  size_t StripOf(int y, int column) const {
    return static_cast<size_t>(y) * strips_ + static_cast<size_t>(column / lattice_.StripCells());
  }
  /// Places of the points of one strip, after all that have one.
  void Append(absl::Span<const size_t> points, absl::Span<const std::array<int, 2>> pixels);

  const Lattice& lattice_;
  const size_t strips_;  // of a row
  int point_rows_ = 0;
  std::vector<Place> places_;
  std::vector<PointRun> runs_;
  std::vector<size_t> first_runs_;   // of each strip, and the end
  std::vector<int32_t> left_, own_;  // as in PointCells, row by row of points
  std::vector<float> part_;
};

}  // namespace lumifold::filter
