#include "filter/manifold/lattice.h"

namespace lumifold::filter {
namespace {

template <int kStep>
void AddRow(int columns, const float* __restrict values, float* __restrict cells) {
  for (int c = 0; c < columns; ++c) {
    float sum = 0;
    for (int j = 0; j < kStep; ++j) sum += values[c * kStep + j];
    cells[c] += sum;
  }
}

}  // namespace

void RowExpander::BlendRows(const Plane& cells, int y) {
  const int columns = lattice_.Columns();
  const float position = (static_cast<float>(y) + 0.5f) / static_cast<float>(lattice_.step) - 0.5f;
  const int last = lattice_.Rows() - 1;
  const int below = std::min(static_cast<int>(position + 1.0f), last);  // position > -1
  const int above = std::clamp(static_cast<int>(position + 1.0f) - 1, 0, last);
  const float fraction = position - static_cast<float>(static_cast<int>(position + 1.0f) - 1);
  const float* __restrict upper = cells.Row(above);
  const float* __restrict lower = cells.Row(below);
  float* __restrict blended = blended_.data() + 1;
  for (int c = 0; c < columns; ++c) blended[c] = upper[c] + fraction * (lower[c] - upper[c]);
  blended[-1] = blended[0];
  blended[columns] = blended[columns - 1];
}

template <int kStep>
void RowExpander::Widen() {
  const int step = kStep > 0 ? kStep : lattice_.step;
  const float* __restrict blended = blended_.data();
  float* __restrict row = row_.data();
  for (int c = 0; c <= lattice_.Columns(); ++c) {
    const float left = blended[c];
    const float slope = (blended[c + 1] - left) / static_cast<float>(step);
    for (int j = 0; j < step; ++j) row[c * step + j] = left + (static_cast<float>(j) + 0.5f) * slope;
  }
}

const float* RowExpander::Expand(const Plane& cells, int y) {
  if (lattice_.step == 1) return cells.Row(y);
  BlendRows(cells, y);
  switch (lattice_.step) {
    case 2:
      Widen<2>();
      break;
    case 4:
      Widen<4>();
      break;
    case 8:
      Widen<8>();
      break;
    default:
      Widen<0>();
  }
  return row_.data() + lattice_.step / 2;
}

void AddRowToCells(const Lattice& lattice, const float* values, float* cells) {
  const int columns = lattice.Columns();
  switch (lattice.step) {
    case 1:
      return AddRow<1>(columns, values, cells);
    case 2:
      return AddRow<2>(columns, values, cells);
    case 4:
      return AddRow<4>(columns, values, cells);
    default:
      for (int c = 0; c < columns; ++c) {
        for (int j = 0; j < lattice.step; ++j) cells[c] += values[c * lattice.step + j];
      }
  }
}

}  // namespace lumifold::filter
