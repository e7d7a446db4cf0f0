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

namespace {

/// phases[j][c] = row[c * step + j] for the cells that lie in the row as a whole. Phases side by side become
/// vectors.
template <int step>
void TakeApart(const float* __restrict row, int cells, std::ptrdiff_t stride, float* __restrict phases) {
  for (int c = 0; c < cells; ++c) {
    for (int j = 0; j < step; ++j) phases[j * stride + c] = row[c * step + j];
  }
}
template <int step>
void PutTogether(const float* __restrict phases, int cells, std::ptrdiff_t stride, float* __restrict row) {
  for (int c = 0; c < cells; ++c) {
    for (int j = 0; j < step; ++j) row[c * step + j] = phases[j * stride + c];
  }
}

}  // namespace

void PutByPhase(ConstFloatView plane, const Lattice& lattice, TaskPool* pool, Plane* by_phase) {
  const int step = lattice.step;
  const std::ptrdiff_t stride = lattice.PhaseStride();
  const int whole = step == 2 || step == 4 ? lattice.width / step : 0;
  ForEachBand(pool, lattice.height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      const float* from = plane.Row(y);
      float* phases = by_phase->Row(y);
      if (step == 4) TakeApart<4>(from, whole, stride, phases);
      if (step == 2) TakeApart<2>(from, whole, stride, phases);
      for (int j = 0; j < step; ++j) {
        float* to = phases + j * stride;
        const int cells = (lattice.width - j + step - 1) / step;
        for (int c = whole; c < cells; ++c) to[c] = from[c * step + j];
        std::fill(to + cells, to + stride, 0.0f);
      }
    }
  });
}

Plane InOrder(const Plane& by_phase, const Lattice& lattice, TaskPool* pool) {
  const int step = lattice.step;
  const std::ptrdiff_t stride = lattice.PhaseStride();
  const int whole = step == 2 || step == 4 ? lattice.width / step : 0;
  Plane plane = Plane::Uninitialized(lattice.width, lattice.height);
  ForEachBand(pool, lattice.height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      const float* phases = by_phase.Row(y);
      float* to = plane.Row(y);
      if (step == 4) PutTogether<4>(phases, whole, stride, to);
      if (step == 2) PutTogether<2>(phases, whole, stride, to);
      for (int x = whole * step; x < lattice.width; ++x) to[x] = phases[lattice.Place(x)];
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
