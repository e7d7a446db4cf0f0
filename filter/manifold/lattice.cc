#include "filter/manifold/lattice.h"

#include <bit>

#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {

CellSpan SpanOf(int p, int step, int cells) {
  if (step == 1) return {p, p, 0.0f};
  const int shifted = p + step / 2;  // counted from the centre of the cell before the first
  const int first = (shifted >> std::countr_zero(static_cast<unsigned>(step))) - 1;
  const float part = (static_cast<float>(shifted & (step - 1)) + 0.5f) / static_cast<float>(step);
  return {std::max(first, 0), std::min(first + 1, cells - 1), part};
}

void StoreCellMeans(const Lattice& lattice, int row, int x0, int count, float* sums, float* cells) {
  const int columns = (count + lattice.step - 1) / lattice.step;
  const int rows = lattice.RowHeight(row);
  int left = columns * lattice.step;
  std::fill(sums + count, sums + left, 0.0f);
  const bool are_whole = left == count && rows == lattice.step;
  for (int step = lattice.step; step > 2; step /= 2, left /= 2) AddPairs(sums, left, 1.0f, sums);
  float* means = cells + x0 / lattice.step;
  // The area of whole cells is a power of two: its inverse gives the quotient's bits.
  const float scale = are_whole ? 1.0f / static_cast<float>(lattice.step * rows) : 1.0f;
  if (lattice.step > 1)
    AddPairs(sums, left, scale, means);
  else
    std::copy_n(sums, columns, means);
  for (int c = 0; c < columns && !are_whole; ++c)
    means[c] /= static_cast<float>(lattice.ColumnWidth(x0 / lattice.step + c) * rows);
}

}  // namespace lumifold::filter
