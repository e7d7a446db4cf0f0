#include "filter/manifold/splat.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

/// Cells a strip reads: its own, one on each side, and what a vector may read past them.
constexpr size_t kEtaStride = kStripColumns + 2 + kCellPadding;

/// sums[c] of a strip: the means of its cells, into `cells` from the strip's first on.
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

}  // namespace

StripSplat::StripSplat(PixelState* state, Level* level)
    : state_(*state),
      level_(*level),
      sums_((state->signals.size() + 2 * state->features.size() + 3) * kSumStride),
      eta_(state->features.size() * kEtaStride),
      upper_(state->features.size()),
      lower_(state->features.size()),
      feature_rows_(state->features.size()),
      signal_rows_(state->signals.size()) {
  for (size_t i = 0; i * kSumStride < sums_.size(); ++i) sum_rows_.push_back(Sums(i));
}

void StripSplat::CellRow(int row) {
  for (int x0 = 0; x0 < state_.lattice.width; x0 += kStripColumns) {
    for (size_t i = 0; i < level_.manifolds.size(); ++i) Strip(i, row, x0);
  }
}

void StripSplat::Strip(size_t manifold, int row, int x0) {
  const Lattice& lattice = state_.lattice;
  const int count = std::min(kStripColumns, lattice.width - x0);
  const bool splits = !level_.children.empty();
  const size_t planes = state_.signals.size() + 1;
  const size_t cluster_planes = state_.features.size() + 1;
  const size_t strips = planes + (splits ? 2 * cluster_planes : 0);
  for (size_t i = 0; i < strips; ++i) std::fill_n(Sums(i), count, 0.0f);
  SplatFound found;
  for (int y = row * lattice.step; y < row * lattice.step + lattice.RowHeight(row); ++y) {
    const SplatFound in_row = PixelRow(manifold, y, x0, count);
    found.has_weight |= in_row.has_weight;
    found.has_members |= in_row.has_members;
  }
  const auto store = [&](bool has_values, float* sums, Plane* cells) {
    float* to = cells->Row(row);
    if (has_values) return StoreCellMeans(lattice, row, x0, count, sums, to);
    std::fill_n(to + x0 / lattice.step, (count + lattice.step - 1) / lattice.step, 0.0f);
  };
  for (size_t c = 0; c < planes; ++c) store(found.has_weight, Sums(c), &level_.splats[manifold][c]);
  for (size_t side = 0; side < 2 && splits; ++side) {
    ClusterSums& child = level_.children[2 * manifold + side];
    const size_t first = planes + side * cluster_planes;
    for (size_t k = 0; k < cluster_planes; ++k) {
      Plane& cells = k + 1 < cluster_planes ? child.weighted[k] : child.weight;
      store(found.has_members, Sums(first + k), &cells);
    }
  }
}

SplatFound StripSplat::PixelRow(size_t manifold, int y, int x0, int count) {
  const Lattice& lattice = state_.lattice;
  const Manifold& from = level_.manifolds[manifold];
  const CellSpan span = SpanOf(y, lattice.step, lattice.Rows());
  const size_t d = state_.features.size();
  for (size_t k = 0; k < d; ++k) {
    upper_[k] = from.eta[k].Row(span.first);
    lower_[k] = from.eta[k].Row(span.second);
    feature_rows_[k] = state_.features[k].Row(y) + x0;
  }
  for (size_t c = 0; c < signal_rows_.size(); ++c) signal_rows_[c] = state_.signals[c].Row(y) + x0;
  BlendCells({upper_.data(), lower_.data(), span.part, d, x0 / lattice.step - 1, count / lattice.step + 3,
              lattice.Columns(), eta_.data(), kEtaStride});
  const SplatArgs splat = {feature_rows_.data(),
                           eta_.data(),
                           kEtaStride,
                           d,
                           signal_rows_.data(),
                           signal_rows_.size(),
                           state_.mask.Row(y) + x0,
                           state_.weights[manifold].Row(y) + x0,
                           sum_rows_.data(),
                           count};
  if (level_.children.empty()) return SplatRow(state_.widening, splat, nullptr);
  float* const* child_sums = sum_rows_.data() + signal_rows_.size() + 1;
  const SplitArgs split = {
      from.axis.data(),           static_cast<float>(manifold),   state_.labels.Row(y) + x0,
      state_.members.Row(y) + x0, state_.next_labels.Row(y) + x0, child_sums,
      child_sums + d + 1};
  return SplatRow(state_.widening, splat, &split);
}

void RootCellRow(const PixelState& state, int row, ClusterSums* sums) {
  const Lattice& lattice = state.lattice;
  const std::vector<float> ones(kStripColumns, 1.0f);
  std::vector<float> strip(kStripColumns);
  for (int x0 = 0; x0 < lattice.width; x0 += kStripColumns) {
    const int count = std::min(kStripColumns, lattice.width - x0);
    for (size_t k = 0; k <= state.features.size(); ++k) {
      const bool is_weight = k == state.features.size();
      std::fill(strip.begin(), strip.end(), 0.0f);
      for (int y = row * lattice.step; y < row * lattice.step + lattice.RowHeight(row); ++y) {
        const float* feature = is_weight ? ones.data() : state.features[k].Row(y) + x0;
        AddProductRow(state.members.Row(y) + x0, feature, count, strip.data());
      }
      StoreCellMeans(lattice, row, x0, count, strip.data(),
                     (is_weight ? sums->weight : sums->weighted[k]).Row(row));
    }
  }
}

}  // namespace lumifold::filter
