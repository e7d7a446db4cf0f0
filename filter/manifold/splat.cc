#include "filter/manifold/splat.h"

#include <algorithm>

#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {

StripSplat::StripSplat(const Planes& signals, const Plane& mask, const Planes& weights,
                       const Lattice& lattice, const Sites& sites, std::vector<Planes>* splats)
    : signals_(signals),
      mask_(mask),
      weights_(weights),
      lattice_(lattice),
      sites_(sites),
      splats_(*splats),
      sums_((signals.size() + 1) * lattice.SumFloats()),
      signal_rows_(signals.size()) {
  for (size_t i = 0; i < sums_.size(); i += lattice.SumFloats()) sum_rows_.push_back(sums_.data() + i);
}

void StripSplat::CellRow(int row) {
  for (int column = 0; column < lattice_.Columns(); column += lattice_.StripCells()) {
    for (size_t i = 0; i < weights_.size(); ++i) Strip(i, row, column);
  }
}

SplatArgs StripSplat::Args(size_t manifold, int row, int x, int count) {
  for (size_t c = 0; c < signals_.size(); ++c) signal_rows_[c] = signals_[c].Row(row) + x;
  return {signal_rows_.data(),
          signal_rows_.size(),
          mask_.Row(row) + x,
          weights_[manifold].Row(row) + x,
          sum_rows_.data(),
          lattice_.PhaseStride(),
          count};
}

void StripSplat::Strip(size_t manifold, int row, int column) {
  const int count = lattice_.CellsFrom(column);
  const int first = row * lattice_.step;
  const int last = first + lattice_.RowHeight(row);
  bool has_weight = false;
  for (int y = first; y < last; ++y) has_weight |= SplatRow(lattice_.step, Args(manifold, y, column, count));
  for (int y = first; y < last; ++y) {
    for (const PointRun& run : sites_.RunsOf(y, column))
      has_weight |= SplatPoints(sites_.CellsOf(run), Args(manifold, run.row, run.x, 0));
  }
  for (size_t c = 0; c < sum_rows_.size(); ++c) {
    float* cells = splats_[manifold][c].Row(row);
    if (has_weight)
      StoreCellMeans(lattice_, row, column, count, sum_rows_[c], cells);
    else
      std::fill_n(cells + column, count, 0.0f);
  }
}

}  // namespace lumifold::filter
