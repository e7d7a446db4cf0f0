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
      sums_(weights.size() * (signals.size() + 1) * lattice.SumFloats()),
      signal_rows_(signals.size()) {
  for (size_t i = 0; i < sums_.size(); i += lattice.SumFloats()) sum_rows_.push_back(sums_.data() + i);
}

void StripSplat::CellRow(int row) {
  const int first = row * lattice_.step;
  const int last = first + lattice_.RowHeight(row);
  for (int column = 0; column < lattice_.Columns(); column += lattice_.StripCells()) {
    const int count = lattice_.CellsFrom(column);
    std::vector<bool> has_weight(weights_.size());
    for (int y = first; y < last; ++y) {  // all manifolds before the next row: its signals stay in the cache
      for (size_t i = 0; i < weights_.size(); ++i)
        has_weight[i] = SplatRow(lattice_.step, Args(i, y, column, count)) || has_weight[i];
    }
    for (int y = first; y < last; ++y) {
      for (const PointRun& run : sites_.RunsOf(y, column)) {
        for (size_t i = 0; i < weights_.size(); ++i)
          has_weight[i] = SplatPoints(sites_.CellsOf(run), Args(i, run.row, run.x, 0)) || has_weight[i];
      }
    }
    for (size_t i = 0; i < weights_.size(); ++i) StoreSums(i, has_weight[i], row, column);
  }
}

void StripSplat::StoreSums(size_t manifold, bool has_weight, int row, int column) {
  const int count = lattice_.CellsFrom(column);
  for (size_t c = 0; c <= signals_.size(); ++c) {
    float* cells = splats_[manifold][c].Row(row);
    if (has_weight)
      StoreCellMeans(lattice_, row, column, count, SumsOf(manifold)[c], cells);
    else
      std::fill_n(cells + column, count, 0.0f);
  }
}

SplatArgs StripSplat::Args(size_t manifold, int row, int x, int count) {
  for (size_t c = 0; c < signals_.size(); ++c) signal_rows_[c] = signals_[c].Row(row) + x;
  return {signal_rows_.data(),
          signal_rows_.size(),
          mask_.Row(row) + x,
          weights_[manifold].Row(row) + x,
          SumsOf(manifold),
          lattice_.PhaseStride(),
          count};
}

}  // namespace lumifold::filter
