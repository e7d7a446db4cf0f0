#include "filter/baselines/guided.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "filter/baselines/standardise.h"
#include "filter/image/check.h"
#include "filter/image/planes.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/filter_layers.h"

namespace lumifold::filter {
namespace {

constexpr int kMostGuides = 12;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostGuides, kMostGuides>;
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostGuides, 1>;

Plane Product(const Plane& x, const Plane& y) {
  Plane product(x.width(), x.height());
  ForEachPixel(x.width(), x.height(), [&](int i, int j) { product.At(i, j) = x.At(i, j) * y.At(i, j); });
  return product;
}

/// Means over windows, in this order: M guides, C signals, the M (M + 1) / 2 products of guides, the M C
/// products of guides and signals, guide by guide.
Planes Moments(const Planes& signals, const Planes& guide, ConstFloatView mask, int radius, TaskPool* pool) {
  Planes moments;
  for (const Plane& g : guide) moments.push_back(g.Clone());
  for (const Plane& p : signals) moments.push_back(p.Clone());
  for (size_t i = 0; i < guide.size(); ++i) {
    for (size_t j = i; j < guide.size(); ++j) moments.push_back(Product(guide[i], guide[j]));
  }
  for (const Plane& g : guide) {
    for (const Plane& p : signals) moments.push_back(Product(g, p));
  }
  return BoxMeans(moments, mask, radius, pool);
}

/// Solves the window of one pixel. Writes a (M planes) and b (one plane) of each signal.
void FitWindow(const Planes& moments, size_t guides, size_t signals, double epsilon, int x, int y,
               Planes* lines) {
  const auto at = [&](size_t i) { return static_cast<double>(moments[i].At(x, y)); };
  Matrix covariance(guides, guides);
  size_t next = guides + signals;
  for (size_t i = 0; i < guides; ++i) {
    for (size_t j = i; j < guides; ++j) {
      covariance(i, j) = covariance(j, i) = at(next++) - at(i) * at(j);
    }
    covariance(i, i) += epsilon;
  }
  const Eigen::LDLT<Matrix> solver(covariance);
  for (size_t c = 0; c < signals; ++c) {
    Vector with_signal(guides);
    for (size_t i = 0; i < guides; ++i) with_signal(i) = at(next + i * signals + c) - at(i) * at(guides + c);
    const Vector a = solver.solve(with_signal);
    double b = at(guides + c);
    for (size_t i = 0; i < guides; ++i) {
      b -= a(i) * at(i);
      (*lines)[c * (guides + 1) + i].At(x, y) = static_cast<float>(a(i));
    }
    (*lines)[c * (guides + 1) + guides].At(x, y) = static_cast<float>(b);
  }
}

Picture FilterLight(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const auto filter_layer = [&](const Halves& halves, const Planes& geometry) {
    const ConstFloatView mask = halves.weight.view();
    const Planes guide = Standardise(geometry, mask, true, pool).planes;
    const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), pool);
    return GuidedFilter(mean, guide, mask, static_cast<int>(values[0]), static_cast<double>(values[1]), pool);
  };
  return FilterLayers(film.pixels, filter_layer, pool);
}

}  // namespace

Planes GuidedFilter(const Planes& signals, const Planes& guide, ConstFloatView mask, int radius,
                    double epsilon, TaskPool* pool) {
  LUMIFOLD_CHECK(guide.size() <= kMostGuides);
  const size_t m = guide.size();
  // Means are subtracted first: E[gp] - E[g] E[p] would lose digits to cancellation.
  const StandardPlanes centred = Standardise(signals, mask, false, pool);
  const Planes moments = Moments(centred.planes, guide, mask, radius, pool);
  Planes lines = MakePlanes(signals.size() * (m + 1), mask.width(), mask.height());
  ParallelFor(pool, mask.height(), [&](int64_t row) {
    for (int x = 0; x < mask.width(); ++x)
      FitWindow(moments, m, signals.size(), epsilon, x, static_cast<int>(row), &lines);
  });
  lines = BoxMeans(lines, mask, radius, pool);
  Planes out = MakePlanes(signals.size(), mask.width(), mask.height());
  for (size_t c = 0; c < signals.size(); ++c) {
    ForEachPixel(mask.width(), mask.height(), [&](int x, int y) {
      float value = centred.means[c] + lines[c * (m + 1) + m].At(x, y);
      for (size_t i = 0; i < m; ++i) value += lines[c * (m + 1) + i].At(x, y) * guide[i].At(x, y);
      out[c].At(x, y) = value;
    });
  }
  return out;
}

Baseline GuidedBaseline() {
  return {
      .info =
          {.name = "guided",
           .summary = "guided filter on each layer of light, by normals and depth",
           .source = "He et al. 2010; Bauszat et al. 2011, without guide rays",
           .parameters =
               {{"radius", "of the windows, in pixels", 12, {2, 4, 8, 12, 24}, 1, 256},
                {"epsilon", "ridge, over the guide's variance", 1e-3f, {1e-4f, 1e-3f, 1e-2f}, 1e-6f, 10}}},
      .filter = FilterLight};
}

}  // namespace lumifold::filter
