#pragma once

#include <algorithm>
#include <cstddef>

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {

/// The coarse grid that manifolds are sampled on: cells of `step` x `step` pixels from the top left; the
/// picture's edge may cut the last ones. A cell's value is that at its centre, pixel (c + 1/2) * step - 1/2.
struct Lattice {
  int width = 0;
  int height = 0;
  int step = 1;  // a power of two

  Lattice(int picture_width, int picture_height, int cell)
      : width(picture_width), height(picture_height), step(cell) {}

  int Columns() const { return (width + step - 1) / step; }
  int Rows() const { return (height + step - 1) / step; }
  /// Pixels of the picture in column or row c of cells.
  int ColumnWidth(int c) const { return std::min(step, width - c * step); }
  int RowHeight(int r) const { return std::min(step, height - r * step); }

  /// Rows of pixels by phase: pixel x is at Place(x).
  int PhaseStride() const { return (Columns() + kRowPadding - 1) / kRowPadding * kRowPadding; }
  int PhasedWidth() const { return step * PhaseStride(); }
  int Place(int x) const { return x % step * PhaseStride() + x / step; }

  /// Cells of a strip.
  int StripCells() const { return kStripColumns / step; }
  /// Floats of a strip of sums. Strips a power of two apart would share a few sets of the cache, and drive
  /// each other out.
  size_t SumFloats() const { return static_cast<size_t>(StripCells()) + kRowPadding; }
  /// Cells of the strip that begins with cell `column`.
  int CellsFrom(int column) const { return std::min(StripCells(), Columns() - column); }
};

/// The plane's rows ordered by phase, into the first rows of `by_phase`; 0 where the picture's edge cuts
/// cells.
void PutByPhase(ConstFloatView plane, const Lattice& lattice, TaskPool* pool, Plane* by_phase);
/// The picture's rows of a plane by phase, in the order of pixels.
Plane InOrder(const Plane& by_phase, const Lattice& lattice, TaskPool* pool);

/// Linear interpolation between the cells of one axis: `part` of the way from cell `first` to cell `second`,
/// both clamped.
struct CellSpan {
  int first;
  int second;
  float part;
};

/// The span of pixel p on an axis of `cells` cells of `step` pixels.
CellSpan SpanOf(int p, int step, int cells);

/// The means over `count` cells of row `row` from cell `column` on, into `cells`, the row's first cell.
/// `sums`: a strip of the cells' sums; becomes 0.
void StoreCellMeans(const Lattice& lattice, int row, int column, int count, float* sums, float* cells);

}  // namespace lumifold::filter
