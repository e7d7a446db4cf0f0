#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "filter/image/plane.h"

namespace lumifold::filter {

/// The coarse grid that manifolds live on: cells of `step` x `step` pixels from the top left, the last ones
/// of a row or column perhaps cut by the picture's edge. A cell's value stands at its centre, in pixels (c +
/// 1/2) * step - 1/2.
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

/// Reads a plane of cells at full resolution, row by row, bilinearly, clamped at the edges. Holds scratch
/// memory: one for each task.
class RowExpander {
 public:
  explicit RowExpander(const Lattice& lattice)
      : lattice_(lattice),
        blended_(static_cast<size_t>(lattice.Columns()) + 2),
        row_(static_cast<size_t>((lattice.Columns() + 1) * lattice.step)) {}

  /// Pixel row y of `cells`: `width` floats, valid until the next call.
  const float* Expand(const Plane& cells, int y);

 private:
  template <int kStep>
  void Widen();
  void BlendRows(const Plane& cells, int y);

  Lattice lattice_;
  std::vector<float> blended_;  // one row of cells between a copy of its first and of its last value
  std::vector<float> row_;
};

/// Adds the pixels of a row to the cells they lie in: cells[c] += sum of values[c * step ..].
/// `values` must hold zeros from the picture's width up to Columns() * step.
void AddRowToCells(const Lattice& lattice, const float* values, float* cells);

}  // namespace lumifold::filter
