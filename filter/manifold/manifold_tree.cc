#include "filter/manifold/manifold_tree.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/kernels/row_kernels.h"
#include "filter/manifold/recursive.h"

namespace lumifold::filter {
namespace {

/// Low-passed features over low-passed weight, in place, drawn to the parent's manifold; 0 where there is
/// neither.
void DivideByWeight(const Plane& weight, const Plane* parent, Plane* eta) {
  const std::vector<float> zeros(static_cast<size_t>(eta->width()), 0.0f);
  for (int y = 0; y < eta->height(); ++y) {
    for (int x = 0; x < eta->width() && parent != nullptr; ++x)
      eta->At(x, y) += kParentMass * parent->At(x, y);
    QuotientRow(weight.Row(y), kLeastClusterMass, zeros.data(), eta->width(), eta->Row(y));
  }
}

/// Distance between the rows of cells that the axis is measured on.
int AxisRowStep(const Plane& cells) { return std::max(1, cells.height() / kAxisRows); }

/// Every AxisRowStep()-th row.
Plane AxisRows(const Plane& cells) {
  const int step = AxisRowStep(cells);
  Plane rows = Plane::Uninitialized(cells.width(), (cells.height() + step - 1) / step);
  for (int y = 0; y < rows.height(); ++y) std::copy_n(cells.Row(y * step), cells.width(), rows.Row(y));
  return rows;
}
ClusterSums AxisRows(const ClusterSums& sums) {
  ClusterSums rows;
  for (const Plane& plane : sums.weighted) rows.weighted.push_back(AxisRows(plane));
  rows.weight = AxisRows(sums.weight);
  return rows;
}

/// Entries of the lower triangle of a symmetric d x d matrix, row by row.
constexpr size_t Pairs(size_t d) { return d * (d + 1) / 2; }

/// Adds the part of row y of `sums`, which is row y * step of the manifold, to the covariance: the lower
/// triangle, then the weight.
void AddRowCovariance(const ClusterSums& sums, const Planes& eta, int step, int y,
                      std::vector<double>* covariance) {
  const size_t d = eta.size();
  std::vector<double> row(covariance->size(), 0.0);
  std::vector<double> offset(d);
  for (int x = 0; x < sums.weight.width(); ++x) {
    const float weight = sums.weight.At(x, y);
    row.back() += static_cast<double>(weight);
    if (weight < kLeastClusterMass) continue;
    for (size_t k = 0; k < d; ++k)
      offset[k] = static_cast<double>(sums.weighted[k].At(x, y) / weight - eta[k].At(x, y * step));
    size_t entry = 0;
    for (size_t i = 0; i < d; ++i) {
      for (size_t j = 0; j <= i; ++j) row[entry++] += static_cast<double>(weight) * offset[i] * offset[j];
    }
  }
  for (size_t entry = 0; entry < row.size(); ++entry) (*covariance)[entry] += row[entry];
}

/// Covariance of the cells' mean features around the manifold, weighted by the cluster's weight in each cell;
/// then the weight. Rows are summed first, so that another processor can have a task for each.
std::vector<double> CellCovariance(const ClusterSums& sums, const Planes& eta, int step) {
  std::vector<double> covariance(Pairs(eta.size()) + 1, 0.0);
  for (int y = 0; y < sums.weight.height(); ++y) AddRowCovariance(sums, eta, step, y, &covariance);
  return covariance;
}

void Normalise(std::vector<double>* v) {
  double squares = 0;
  for (const double x : *v) squares += x * x;
  if (!(squares > 0)) return;
  const double length = std::sqrt(squares);
  for (double& x : *v) x /= length;
}

std::vector<float> SplitAxis(const std::vector<double>& covariance, size_t d, int iterations) {
  const auto at = [&](size_t i, size_t j) { return covariance[i >= j ? Pairs(i) + j : Pairs(j) + i]; };
  std::vector<double> axis(d);
  double spread = 0;
  for (size_t k = 0; k < d; ++k) {
    axis[k] = StartComponent(k);
    spread += at(k, k);
  }
  if (!(spread > kLeastSpread * covariance.back()))
    iterations = 0;  // all cells lie on the manifold: it has no principal axis
  for (int step = 0; step < iterations; ++step) {
    std::vector<double> next(d, 0.0);
    for (size_t i = 0; i < d; ++i) {
      for (size_t j = 0; j < d; ++j) next[i] += at(i, j) * axis[j];
    }
    Normalise(&next);
    axis = next;
  }
  return {axis.begin(), axis.end()};
}

}  // namespace

ClusterSums MakeClusterSums(size_t features, const Lattice& lattice) {
  return {MakeUninitializedPlanes(features, lattice.Columns(), lattice.Rows()),
          Plane::Uninitialized(lattice.Columns(), lattice.Rows())};
}

Manifold MakeManifold(ClusterSums sums, const Planes* parent, float sigma_cells, int iterations,
                      TaskPool* pool) {
  const int axis_step = AxisRowStep(sums.weight);
  const ClusterSums axis_rows = iterations > 0 ? AxisRows(sums) : ClusterSums{};
  LowPass(sigma_cells, &sums.weight);
  if (parent != nullptr)
    ForEachPixel(sums.weight.width(), sums.weight.height(),
                 [&](int x, int y) { sums.weight.At(x, y) += kParentMass; });
  Manifold manifold{std::move(sums.weighted), {}};
  ParallelFor(pool, static_cast<int64_t>(manifold.eta.size()), [&](int64_t task) {
    const size_t k = static_cast<size_t>(task);
    LowPass(sigma_cells, &manifold.eta[k]);
    DivideByWeight(sums.weight, parent != nullptr ? &(*parent)[k] : nullptr, &manifold.eta[k]);
  });
  if (iterations > 0) {
    manifold.axis =
        SplitAxis(CellCovariance(axis_rows, manifold.eta, axis_step), manifold.eta.size(), iterations);
  }
  return manifold;
}

}  // namespace lumifold::filter
