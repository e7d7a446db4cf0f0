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
      sums_((signals.size() + 1) * kSumStride),
      signal_rows_(signals.size()) {
  for (size_t i = 0; i <= signals.size(); ++i) sum_rows_.push_back(sums_.data() + i * kSumStride);
}

void StripSplat::CellRow(int row) {
  for (int x0 = 0; x0 < lattice_.width; x0 += kStripColumns) {
    for (size_t i = 0; i < weights_.size(); ++i) Strip(i, row, x0);
  }
}

void StripSplat::Strip(size_t manifold, int row, int x0) {
  const int count = std::min(kStripColumns, lattice_.width - x0);
  for (float* sums : sum_rows_) std::fill_n(sums, count, 0.0f);
  bool has_weight = false;
  for (int y = row * lattice_.step; y < row * lattice_.step + lattice_.RowHeight(row); ++y) {
    for (size_t c = 0; c < signals_.size(); ++c) signal_rows_[c] = signals_[c].Row(y) + x0;
    has_weight |= SplatRow({signal_rows_.data(), signal_rows_.size(), mask_.Row(y) + x0,
                            weights_[manifold].Row(y) + x0, sum_rows_.data(), count});
  }
  for (size_t c = 0; c < sum_rows_.size(); ++c) {
    float* cells = splats_[manifold][c].Row(row);
    if (has_weight)
      StoreCellMeans(lattice_, row, x0, count, sum_rows_[c], cells);
    else
      std::fill_n(cells + x0 / lattice_.step, (count + lattice_.step - 1) / lattice_.step, 0.0f);
  }
}

}  // namespace lumifold::filter
