#include "filter/manifold/splat.h"

#include <algorithm>

#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {

StripSplat::StripSplat(const Planes& signals, const Plane& mask, const Planes& weights,
                       const Lattice& lattice, std::vector<Planes>* splats)
    : signals_(signals),
      mask_(mask),
      weights_(weights),
      lattice_(lattice),
      splats_(*splats),
      sums_((signals.size() + 1) * lattice.SumFloats()),
      sum_rows_(signals.size() + 1),
      signal_rows_(signals.size()) {}

void StripSplat::CellRow(int row) {
  for (int column = 0; column < lattice_.Columns(); column += lattice_.StripCells()) {
    for (size_t i = 0; i < weights_.size(); ++i) Strip(i, row, column);
  }
}

void StripSplat::Strip(size_t manifold, int row, int column) {
  const int count = lattice_.CellsFrom(column);
  bool has_weight = false;
  for (int y = row * lattice_.step; y < row * lattice_.step + lattice_.RowHeight(row); ++y) {
    for (int j = 0; j < lattice_.step; ++j) {
      const int x = j * lattice_.PhaseStride() + column;
      for (size_t c = 0; c < signals_.size(); ++c) signal_rows_[c] = signals_[c].Row(y) + x;
      for (size_t c = 0; c < sum_rows_.size(); ++c)
        sum_rows_[c] = sums_.data() + c * lattice_.SumFloats() + j * lattice_.SumStride();
      has_weight |= SplatRow({signal_rows_.data(), signal_rows_.size(), mask_.Row(y) + x,
                              weights_[manifold].Row(y) + x, sum_rows_.data(), count});
    }
  }
  for (size_t c = 0; c < sum_rows_.size(); ++c) {
    float* cells = splats_[manifold][c].Row(row);
    if (has_weight)
      StoreCellMeans(lattice_, row, column, count, sums_.data() + c * lattice_.SumFloats(), cells);
    else
      std::fill_n(cells + column, count, 0.0f);
  }
}

}  // namespace lumifold::filter
