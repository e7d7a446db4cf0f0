#include "filter/manifold/slice.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

constexpr size_t kPsiStride = kStripColumns + 2 + kCellPadding;

}  // namespace

StripSlice::StripSlice(const Planes& weights, const std::vector<Planes>& psi, const Lattice& lattice,
                       const Phases& phases, const Sites& sites)
    : weights_(weights),
      psi_(psi),
      lattice_(lattice),
      phases_(phases),
      sites_(sites),
      planes_(psi[0].size()),
      cells_(psi.size() * planes_ * kPsiStride),
      upper_(psi.size() * planes_),
      lower_(upper_.size()),
      weight_rows_(psi.size()),
      sum_rows_(planes_) {}

SliceArgs StripSlice::Args(int row, int x, bool adds, Planes* sums) {
  for (size_t i = 0; i < weight_rows_.size(); ++i) weight_rows_[i] = weights_[i].Row(row) + x;
  for (size_t c = 0; c < planes_; ++c) sum_rows_[c] = (*sums)[c].Row(row) + x;
  return {.weights = weight_rows_.data(),
          .manifolds = weight_rows_.size(),
          .psi = cells_.data(),
          .psi_stride = kPsiStride,
          .planes = planes_,
          .sums = sum_rows_.data(),
          .adds = adds,
          .phase_stride = lattice_.PhaseStride(),
          .count = 0};
}

void StripSlice::PixelRow(int y, bool adds, Planes* sums) {
  const CellSpan span = SpanOf(y, lattice_.step, lattice_.Rows());
  for (size_t i = 0; i < upper_.size(); ++i) {
    const Plane& cells = psi_[i / planes_][i % planes_];
    upper_[i] = cells.Row(span.first);
    lower_[i] = cells.Row(span.second);
  }
  for (int column = 0; column < lattice_.Columns(); column += lattice_.StripCells()) {
    const int count = lattice_.CellsFrom(column);
    BlendCells({upper_.data(), lower_.data(), span.part, upper_.size(), column - 1, count + 2,
                lattice_.Columns(), cells_.data(), kPsiStride});
    SliceArgs args = Args(y, column, adds, sums);
    args.count = count;
    SliceRow(phases_, args);
    for (const PointRun& run : sites_.RunsOf(y, column))
      SliceAtPoints(sites_.CellsOf(run), Args(run.row, run.x, adds, sums));
  }
}

}  // namespace lumifold::filter
