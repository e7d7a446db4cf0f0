#pragma once

#include <algorithm>

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
};

/// Linear interpolation between the cells of one axis: `part` of the way from cell `first` to cell `second`,
/// both clamped.
struct CellSpan {
  int first;
  int second;
  float part;
};

/// The span of pixel p on an axis of `cells` cells of `step` pixels.
CellSpan SpanOf(int p, int step, int cells);

/// The means over the cells of a strip, `count` pixels of row `row` of cells from pixel x0 on, into `cells`
/// from the strip's first on. `sums`: for each column of pixels the sum over the cells' rows; overwritten.
void StoreCellMeans(const Lattice& lattice, int row, int x0, int count, float* sums, float* cells);

}  // namespace lumifold::filter
