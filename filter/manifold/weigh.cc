#include "filter/manifold/weigh.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

/// Cells a strip reads: its own, one on each side, and what a vector may read past them.
constexpr size_t kEtaStride = kStripColumns + 2 + kCellPadding;

}  // namespace

Clusters::Clusters(const Plane& mask, TaskPool* pool)
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

StripWeigh::StripWeigh(const Planes& features, const Lattice& lattice, const Phases& phases,
                       const Sites& sites, const SlicePoints* points, Clusters* clusters, Level* level)
    : features_(features),
      lattice_(lattice),
      phases_(phases),
      sites_(sites),
      points_(points),
      clusters_(*clusters),
      level_(*level),
      sums_(level->children.size() * (features.size() + 1) * lattice.SumFloats()),
      eta_(features.size() * kEtaStride),
      upper_(features.size()),
      lower_(features.size()),
      feature_rows_(features.size()) {
  for (size_t i = 0; i < sums_.size(); i += lattice.SumFloats()) sum_rows_.push_back(sums_.data() + i);
}

void StripWeigh::CellRow(int row) {
  const size_t manifolds = level_.manifolds.size();
  for (int column = 0; column < lattice_.Columns(); column += lattice_.StripCells()) {
    std::vector<bool> has_members(manifolds);
    for (int y = row * lattice_.step; y < row * lattice_.step + lattice_.RowHeight(row); ++y) {
      // All manifolds before the next row: its features stay in the cache.
      for (size_t i = 0; i < manifolds; ++i) has_members[i] = PixelRow(i, y, column) || has_members[i];
    }
    for (size_t child = 0; child < level_.children.size(); ++child)
      StoreSums(child, has_members[child / 2], row, column);
  }
}

void StripWeigh::StoreSums(size_t child, bool has_members, int row, int column) {
  const int count = lattice_.CellsFrom(column);
  ClusterSums& of = level_.children[child];
  float* const* sums = SumsOf(child);
  for (size_t k = 0; k <= features_.size(); ++k) {
    float* cells = (k < features_.size() ? of.weighted[k] : of.weight).Row(row);
    if (has_members)
      StoreCellMeans(lattice_, row, column, count, sums[k], cells);
    else
      std::fill_n(cells + column, count, 0.0f);
  }
}

bool StripWeigh::PixelRow(size_t manifold, int y, int column) {
  const Manifold& from = level_.manifolds[manifold];
  const CellSpan span = SpanOf(y, lattice_.step, lattice_.Rows());
  const int count = lattice_.CellsFrom(column);
  const size_t d = features_.size();
  for (size_t k = 0; k < d; ++k) {
    upper_[k] = from.eta[k].Row(span.first);
    lower_[k] = from.eta[k].Row(span.second);
  }
  BlendCells({upper_.data(), lower_.data(), span.part, d, column - 1, count + 2, lattice_.Columns(),
              eta_.data(), kEtaStride});
  PointRow(manifold, y, column);
  for (size_t k = 0; k < d; ++k) feature_rows_[k] = features_[k].Row(y) + column;
  const WeighArgs weigh = {feature_rows_.data(),
                           eta_.data(),
                           kEtaStride,
                           d,
                           level_.weights[manifold].Row(y) + column,
                           clusters_.total.Row(y) + column,
                           lattice_.PhaseStride(),
                           count};
  if (level_.children.empty()) return WeighRow(phases_, weigh, nullptr);
  const SplitArgs split = {from.axis.data(),
                           static_cast<float>(manifold),
                           clusters_.labels.Row(y) + column,
                           clusters_.members.Row(y) + column,
                           clusters_.next_labels.Row(y) + column,
                           SumsOf(2 * manifold),
                           SumsOf(2 * manifold + 1)};
  return WeighRow(phases_, weigh, &split);
}

void StripWeigh::PointRow(size_t manifold, int y, int column) {
  for (const PointRun& run : sites_.RunsOf(y, column)) {
    for (size_t k = 0; k < features_.size(); ++k) feature_rows_[k] = features_[k].Row(run.row) + run.x;
    WeighPoints(sites_.CellsOf(run),
                {.features = feature_rows_.data(),
                 .eta = eta_.data(),
                 .eta_stride = kEtaStride,
                 .dimensions = features_.size(),
                 .weight = level_.weights[manifold].Row(run.row) + run.x,
                 .total = clusters_.total.Row(run.row) + run.x,
                 .phase_stride = 0,
                 .count = 0},
                features_.size() - points_->own_features, points_->pixel_divisor);
  }
}

void RootCellRow(const Planes& features, const Lattice& lattice, const Clusters& clusters, int row,
                 ClusterSums* cell_means) {
  const std::vector<float> ones(static_cast<size_t>(lattice.PhasedWidth()), 1.0f);
  const size_t planes = features.size() + 1;
  std::vector<float> sums(planes * lattice.SumFloats());
  std::vector<float*> sum_rows;
  for (size_t i = 0; i < sums.size(); i += lattice.SumFloats()) sum_rows.push_back(sums.data() + i);
  std::vector<const float*> feature_rows(features.size());
  for (int column = 0; column < lattice.Columns(); column += lattice.StripCells()) {
    const int count = lattice.CellsFrom(column);
    for (int y = row * lattice.step; y < row * lattice.step + lattice.RowHeight(row); ++y) {
      for (size_t k = 0; k < features.size(); ++k) feature_rows[k] = features[k].Row(y) + column;
      SplatRow(lattice.step, {feature_rows.data(), features.size(), clusters.members.Row(y) + column,
                              ones.data(), sum_rows.data(), lattice.PhaseStride(), count});
    }
    for (size_t k = 0; k < planes; ++k) {
      Plane& cells = k < features.size() ? cell_means->weighted[k] : cell_means->weight;
      StoreCellMeans(lattice, row, column, count, sum_rows[k], cells.Row(row));
    }
  }
}

}  // namespace lumifold::filter
