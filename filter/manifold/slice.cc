#include "filter/manifold/slice.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

constexpr size_t kPsiStride = kStripColumns + 2 + kCellPadding;

}  // namespace

StripSlice::StripSlice(const PixelState& state, const std::vector<Planes>& psi)
    : state_(state),
      psi_(psi),
      planes_(psi[0].size()),
      cells_(psi.size() * planes_ * kPsiStride),
      upper_(psi.size() * planes_),
      lower_(upper_.size()),
      weight_rows_(psi.size()),
      sum_rows_(planes_) {}

void StripSlice::PixelRow(int y, Planes* sums) {
  const Lattice& lattice = state_.lattice;
  const CellSpan span = SpanOf(y, lattice.step, lattice.Rows());
  for (size_t i = 0; i < upper_.size(); ++i) {
    const Plane& cells = psi_[i / planes_][i % planes_];
    upper_[i] = cells.Row(span.first);
    lower_[i] = cells.Row(span.second);
  }
  for (int x0 = 0; x0 < lattice.width; x0 += kStripColumns) {
    const int count = std::min(kStripColumns, lattice.width - x0);
    BlendCells({upper_.data(), lower_.data(), span.part, upper_.size(), x0 / lattice.step - 1,
                count / lattice.step + 3, lattice.Columns(), cells_.data(), kPsiStride});
    for (size_t i = 0; i < weight_rows_.size(); ++i) weight_rows_[i] = state_.weights[i].Row(y) + x0;
    for (size_t c = 0; c < planes_; ++c) sum_rows_[c] = (*sums)[c].Row(y) + x0;
    SliceRow(state_.widening, {weight_rows_.data(), weight_rows_.size(), cells_.data(), kPsiStride, planes_,
                               sum_rows_.data(), count});
  }
}

}  // namespace lumifold::filter
