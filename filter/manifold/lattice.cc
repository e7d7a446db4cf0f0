#include "filter/manifold/lattice.h"

#include <bit>

#include "filter/image/planes.h"

namespace lumifold::filter {

CellSpan SpanOf(int p, int step, int cells) {
  if (step == 1) return {p, p, 0.0f};
  const int shifted = p + step / 2;  // counted from the centre of the cell before the first
  const int first = (shifted >> std::countr_zero(static_cast<unsigned>(step))) - 1;
  const float part = (static_cast<float>(shifted & (step - 1)) + 0.5f) / static_cast<float>(step);
  return {std::max(first, 0), std::min(first + 1, cells - 1), part};
}

void PutByPhase(ConstFloatView plane, const Lattice& lattice, TaskPool* pool, Plane* by_phase) {
  const int step = lattice.step;
  ForEachBand(pool, lattice.height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int j = 0; j < step; ++j) {
        const float* from = plane.Row(y) + j;
        float* to = by_phase->Row(y) + j * lattice.PhaseStride();
        const int cells = (lattice.width - j + step - 1) / step;
        for (int c = 0; c < cells; ++c) to[c] = from[c * step];
        std::fill(to + cells, to + lattice.PhaseStride(), 0.0f);
      }
    }
  });
}

Plane InOrder(const Plane& by_phase, const Lattice& lattice, TaskPool* pool) {
  const int step = lattice.step;
  Plane plane = Plane::Uninitialized(lattice.width, lattice.height);
  ForEachBand(pool, lattice.height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int j = 0; j < step; ++j) {
        const float* from = by_phase.Row(y) + j * lattice.PhaseStride();
        float* to = plane.Row(y) + j;
        for (int c = 0; c * step < lattice.width - j; ++c) to[c * step] = from[c];
      }
    }
  });
  return plane;
}

void StoreCellMeans(const Lattice& lattice, int row, int column, int count, float* sums, float* cells) {
  const int rows = lattice.RowHeight(row);
  const float area = static_cast<float>(lattice.step * rows);
  float* means = cells + column;
  for (int c = 0; c < count; ++c) means[c] = sums[c] / area;
  const int last = column + count - 1;
  means[count - 1] = sums[count - 1] / static_cast<float>(lattice.ColumnWidth(last) * rows);
  std::fill_n(sums, count, 0.0f);
}

}  // namespace lumifold::filter
