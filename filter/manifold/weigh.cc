#include "filter/manifold/weigh.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

/// Cells a strip reads: its own, one on each side, and what a vector may read past them.
constexpr size_t kEtaStride = kStripColumns + 2 + kCellPadding;

}  // namespace

Clusters::Clusters(ConstFloatView mask, TaskPool* pool)
    : members(Plane::Uninitialized(mask.width(), mask.height())),
      labels(Plane::Uninitialized(mask.width(), mask.height())),
      next_labels(Plane::Uninitialized(mask.width(), mask.height())),
      total(Plane::Uninitialized(mask.width(), mask.height())) {
  ForEachBand(pool, mask.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      std::copy_n(mask.Row(y), mask.width(), members.Row(y));
      std::fill_n(labels.Row(y), mask.width(), 0.0f);
      std::fill_n(total.Row(y), mask.width(), 0.0f);
    }
  });
}

StripWeigh::StripWeigh(const Planes& features, const Lattice& lattice, const Widening& widening,
                       Clusters* clusters, Level* level)
    : features_(features),
      lattice_(lattice),
      widening_(widening),
      clusters_(*clusters),
      level_(*level),
      sums_(2 * (features.size() + 1) * kSumStride),
      eta_(features.size() * kEtaStride),
      upper_(features.size()),
      lower_(features.size()),
      feature_rows_(features.size()) {
  for (size_t i = 0; i * kSumStride < sums_.size(); ++i) sum_rows_.push_back(Sums(i));
}

void StripWeigh::CellRow(int row) {
  for (int x0 = 0; x0 < lattice_.width; x0 += kStripColumns) {
    for (size_t i = 0; i < level_.manifolds.size(); ++i) Strip(i, row, x0);
  }
}

void StripWeigh::Strip(size_t manifold, int row, int x0) {
  const int count = std::min(kStripColumns, lattice_.width - x0);
  const bool splits = !level_.children.empty();
  for (size_t i = 0; i < sum_rows_.size() && splits; ++i) std::fill_n(Sums(i), count, 0.0f);
  bool has_members = false;
  for (int y = row * lattice_.step; y < row * lattice_.step + lattice_.RowHeight(row); ++y)
    has_members |= PixelRow(manifold, y, x0, count);
  const size_t planes = features_.size() + 1;
  for (size_t i = 0; i < sum_rows_.size() && splits; ++i) {
    ClusterSums& child = level_.children[2 * manifold + i / planes];
    float* cells = (i % planes < features_.size() ? child.weighted[i % planes] : child.weight).Row(row);
    if (has_members)
      StoreCellMeans(lattice_, row, x0, count, Sums(i), cells);
    else
      std::fill_n(cells + x0 / lattice_.step, (count + lattice_.step - 1) / lattice_.step, 0.0f);
  }
}

bool StripWeigh::PixelRow(size_t manifold, int y, int x0, int count) {
  const Manifold& from = level_.manifolds[manifold];
  const CellSpan span = SpanOf(y, lattice_.step, lattice_.Rows());
  const size_t d = features_.size();
  for (size_t k = 0; k < d; ++k) {
    upper_[k] = from.eta[k].Row(span.first);
    lower_[k] = from.eta[k].Row(span.second);
    feature_rows_[k] = features_[k].Row(y) + x0;
  }
  BlendCells({upper_.data(), lower_.data(), span.part, d, x0 / lattice_.step - 1, count / lattice_.step + 3,
              lattice_.Columns(), eta_.data(), kEtaStride});
  const WeighArgs weigh = {
      feature_rows_.data(),        eta_.data(), kEtaStride, d, level_.weights[manifold].Row(y) + x0,
      clusters_.total.Row(y) + x0, count};
  if (level_.children.empty()) return WeighRow(widening_, weigh, nullptr);
  const SplitArgs split = {from.axis.data(),
                           static_cast<float>(manifold),
                           clusters_.labels.Row(y) + x0,
                           clusters_.members.Row(y) + x0,
                           clusters_.next_labels.Row(y) + x0,
                           sum_rows_.data(),
                           sum_rows_.data() + d + 1};
  return WeighRow(widening_, weigh, &split);
}

void RootCellRow(const Planes& features, const Lattice& lattice, const Clusters& clusters, int row,
                 ClusterSums* sums) {
  const std::vector<float> ones(kStripColumns, 1.0f);
  std::vector<float> strip(kStripColumns);
  for (int x0 = 0; x0 < lattice.width; x0 += kStripColumns) {
    const int count = std::min(kStripColumns, lattice.width - x0);
    for (size_t k = 0; k <= features.size(); ++k) {
      const bool is_weight = k == features.size();
      std::fill(strip.begin(), strip.end(), 0.0f);
      for (int y = row * lattice.step; y < row * lattice.step + lattice.RowHeight(row); ++y) {
        const float* feature = is_weight ? ones.data() : features[k].Row(y) + x0;
        AddProductRow(clusters.members.Row(y) + x0, feature, count, strip.data());
      }
      StoreCellMeans(lattice, row, x0, count, strip.data(),
                     (is_weight ? sums->weight : sums->weighted[k]).Row(row));
    }
  }
}

}  // namespace lumifold::filter
