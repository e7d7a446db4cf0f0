#include "filter/manifold/manifold_filter.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "filter/manifold/filter_device.h"
#include "filter/manifold/first_order.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/manifold/recursive.h"
#include "filter/manifold/sites.h"
#include "filter/manifold/slice.h"
#include "filter/manifold/splat.h"
#include "filter/manifold/weigh.h"

// First the whole tree of manifolds, with the weights of all sites on each; then splat, blur and slice level
// by level, so that full-resolution planes are read once for each level. Work at full resolution is per site:
// distance to the manifolds, splat into the site's own cell, slice. All recursion is on cells.
namespace lumifold::filter {
namespace {

bool HasSignals(const SlicePoints* points) { return points != nullptr && !points->signals.empty(); }

Planes SignalsOf(const Planes& signals, const SlicePoints* points, const Sites& sites, TaskPool* pool) {
  Planes planes;
  for (size_t c = 0; c < signals.size(); ++c) {
    const auto of_point = [&](size_t i) {
      return HasSignals(points) ? points->signals[i * signals.size() + c] : 0.0f;
    };
    planes.push_back(sites.PlaneOf(signals[c].view(), of_point, pool));
  }
  return planes;
}

/// The positions that a fit needs: those of points are their pixels'.
void AddPositions(const SlicePoints* points, const Sites& sites, const Lattice& lattice, float unit_px,
                  TaskPool* pool, Planes* signals) {
  for (const Plane& plane : Positions(lattice.width, lattice.height, unit_px)) {
    const auto of_point = [&](size_t i) { return plane.At(points->pixels[i][0], points->pixels[i][1]); };
    signals->push_back(sites.PlaneOf(plane.view(), of_point, pool));
  }
}

Planes FeaturesOf(const Planes& features, const SlicePoints* points, const Sites& sites, TaskPool* pool) {
  const size_t own = points != nullptr ? points->own_features : 0;
  const size_t shared = features.size() - own;
  Planes planes;
  for (size_t k = 0; k < features.size(); ++k) {
    const auto of_point = [&](size_t i) {
      return k < shared ? features[k].At(points->pixels[i][0], points->pixels[i][1])
                        : points->features[i * own + (k - shared)];
    };
    planes.push_back(sites.PlaneOf(features[k].view(), of_point, pool));
  }
  return planes;
}

Plane MaskOf(ConstFloatView mask, const SlicePoints* points, const Sites& sites, TaskPool* pool) {
  return sites.PlaneOf(mask, [&](size_t i) { return HasSignals(points) ? points->weights[i] : 0.0f; }, pool);
}

class Filter {
 public:
  Filter(const Planes& signals, const Planes& features, ConstFloatView mask, const ManifoldParams& params,
         float reach, const SlicePoints* points, TaskPool* pool)
      : lattice_(mask.width(), mask.height(), CellOf(params)),
        phases_(CellOf(params)),
        sites_(lattice_, points),
        points_(points),
        channels_(signals.size()),
        signals_(SignalsOf(signals, points, sites_, pool)),
        features_(FeaturesOf(features, points, sites_, pool)),
        mask_(MaskOf(mask, points, sites_, pool)),
        params_(params),
        reach_(reach),
        pool_(pool) {
    if (params.is_first_order) AddPositions(points, sites_, lattice_, reach, pool, &signals_);
    const size_t results = params.is_first_order ? kMoments : channels_;
    sums_ = MakeUninitializedPlanes(results + 1, sites_.Width(), sites_.Rows());
  }

  ManifoldResult Run() {
    std::vector<Level> tree = BuildTree();
    for (Level& level : tree) {
      const std::vector<Planes> psi = Blur(level, Splat(level));
      Slice(level, psi, /*is_first=*/&level == &tree.front());
      level = {};
    }
    Plane found = DivideSums();
    if (params_.is_first_order)
      sums_ = FitLight(sums_, signals_[channels_], signals_[channels_ + 1], params_.slope_ridge, pool_);
    SlicedPoints at_points = AtPoints(found);
    for (Plane& plane : sums_) plane = InOrder(plane, lattice_, pool_);
    return {std::move(sums_), std::move(at_points)};
  }

 private:
  float InCells(float sigma) const { return sigma / static_cast<float>(lattice_.step); }
  /// Clusters of the last level are not split: they need no axis.
  int AxisSteps(int depth) const { return depth < params_.height ? params_.pca_iterations : 0; }
  ClusterSums RootSums(const Clusters& clusters) const;
  /// Also fills splat_mask_.
  std::vector<Level> BuildTree();
  Level Weigh(std::vector<Manifold> manifolds, bool is_last, Clusters* clusters) const;
  /// What sites weigh in splats that have these sums of weights.
  Plane SplatMask(const Plane& total) const;
  std::vector<Planes> Splat(const Level& level) const;
  std::vector<Planes> Blur(const Level& level, std::vector<Planes> splats) const;
  /// Adds w * Psi of each manifold to the sums; to nothing yet at the first level.
  void Slice(const Level& level, const std::vector<Planes>& psi, bool is_first);
  /// Divides the sums by the weight's, and gives that.
  Plane DivideSums();
  SlicedPoints AtPoints(const Plane& found) const;

  const Lattice lattice_;
  const Phases phases_;
  const Sites sites_;
  const SlicePoints* const points_;
  const size_t channels_;
  Planes signals_;  // these and all planes below: of sites
  const Planes features_;
  const Plane mask_;
  const ManifoldParams params_;
  const float reach_;  // px
  TaskPool* const pool_;
  Plane splat_mask_;
  Planes sums_;  // of w * Psi, the weight's after the signals'
};

ClusterSums Filter::RootSums(const Clusters& clusters) const {
  ClusterSums sums = MakeClusterSums(features_.size(), lattice_);
  ParallelFor(pool_, lattice_.Rows(),
              [&](int64_t row) { RootCellRow(features_, lattice_, clusters, static_cast<int>(row), &sums); });
  return sums;
}

Level Filter::Weigh(std::vector<Manifold> manifolds, bool is_last, Clusters* clusters) const {
  Level level;
  level.manifolds = std::move(manifolds);
  level.weights = MakeUninitializedPlanes(level.manifolds.size(), sites_.Width(), sites_.Rows());
  for (size_t i = 0; i < 2 * level.manifolds.size() && !is_last; ++i)
    level.children.push_back(MakeClusterSums(features_.size(), lattice_));
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    StripWeigh task(features_, lattice_, phases_, sites_, points_, clusters, &level);
    // kBandRows is a multiple of the step: bands share no cells
    for (int row = y0 / lattice_.step; row * lattice_.step < y1; ++row) task.CellRow(row);
  });
  std::swap(clusters->labels, clusters->next_labels);
  return level;
}

std::vector<Level> Filter::BuildTree() {
  const float sigma_cells = InCells(params_.sigma_s);
  Clusters clusters(mask_, pool_);
  std::vector<Level> tree;
  std::vector<Manifold> manifolds;
  manifolds.push_back(MakeManifold(RootSums(clusters), nullptr, sigma_cells, AxisSteps(1), pool_));
  for (int depth = 1; depth <= params_.height; ++depth) {
    tree.push_back(Weigh(std::move(manifolds), depth == params_.height, &clusters));
    Level& level = tree.back();
    manifolds = std::vector<Manifold>(level.children.size());
    ParallelFor(pool_, static_cast<int64_t>(manifolds.size()), [&](int64_t i) {
      const auto at = static_cast<size_t>(i);
      manifolds[at] = MakeManifold(std::move(level.children[at]), &level.manifolds[at / 2].eta, sigma_cells,
                                   AxisSteps(depth + 1), pool_);
    });
  }
  splat_mask_ = SplatMask(clusters.total);
  return tree;
}

Plane Filter::SplatMask(const Plane& total) const {
  Plane splat = mask_.Clone();
  for (size_t i = 0; HasSignals(points_) && i < points_->weights.size(); ++i) {
    const auto [x, y] = points_->pixels[i];
    if (points_->weights[i] > 0) splat.At(lattice_.Place(x), y) = 0;  // the pixel's points stand for it
  }
  if (!params_.keeps_mass) return splat;
  ForEachPixel(pool_, splat.width(), splat.height(),
               [&](int x, int y) { splat.At(x, y) /= std::min(1.0f, total.At(x, y)) + kLeastTotal; });
  return splat;
}

std::vector<Planes> Filter::Splat(const Level& level) const {
  std::vector<Planes> splats;
  splats.reserve(level.manifolds.size());
  for (size_t i = 0; i < level.manifolds.size(); ++i)
    splats.push_back(MakeUninitializedPlanes(signals_.size() + 1, lattice_.Columns(), lattice_.Rows()));
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    StripSplat task(signals_, splat_mask_, level.weights, lattice_, sites_, &splats);
    for (int row = y0 / lattice_.step; row * lattice_.step < y1; ++row) task.CellRow(row);
  });
  return splats;
}

std::vector<Planes> Filter::Blur(const Level& level, std::vector<Planes> splats) const {
  std::vector<Planes> psi(splats.size());
  ParallelFor(pool_, static_cast<int64_t>(psi.size()), [&](int64_t i) {
    const auto at = static_cast<size_t>(i);
    if (params_.is_first_order) AddMoments(&splats[at]);
    psi[at] = GuidedLowPass(InCells(reach_), kBlurRange, level.manifolds[at].eta, splats[at], pool_);
    splats[at].clear();
  });
  return psi;
}

void Filter::Slice(const Level& level, const std::vector<Planes>& psi, bool is_first) {
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    StripSlice slice(level.weights, psi, lattice_, phases_, sites_);
    for (int y = y0; y < y1; ++y) slice.PixelRow(y, !is_first, &sums_);
  });
}

Plane Filter::DivideSums() {
  Plane found = std::move(sums_.back());
  sums_.pop_back();
  // A lost pixel keeps its own signal, a lost point is 0. Where all moments are 0, the fit gives the light.
  const std::vector<float> zeros(static_cast<size_t>(sites_.Width()));
  ForEachBand(pool_, sites_.Rows(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < sums_.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        const bool keeps = c < signals_.size() && y < lattice_.height;
        QuotientRow(found.Row(y), kLeastWeight, keeps ? signals_[c].Row(y) : zeros.data(), sites_.Width(),
                    sums_[c].Row(y));
      }
    }
  });
  return found;
}

SlicedPoints Filter::AtPoints(const Plane& found) const {
  SlicedPoints result;
  result.values.reserve(sites_.PointCount() * sums_.size());
  result.weights.reserve(sites_.PointCount());
  for (size_t i = 0; i < sites_.PointCount(); ++i) {
    for (const Plane& sum : sums_) result.values.push_back(sites_.At(i, sum));
    const float weight = sites_.At(i, found);
    result.weights.push_back(weight < kLeastWeight ? 0.0f : weight);
  }
  return result;
}

}  // namespace

int CellSize(float sigma_s) {
  int size = sigma_s >= 2 ? 2 : 1;
  while (static_cast<float>(8 * size) <= sigma_s && 2 * size <= kBandRows) size *= 2;
  return size;
}

ManifoldResult ManifoldFilterAtPoints(const Planes& signals, const Planes& features, ConstFloatView mask,
                                      const ManifoldParams& params, float reach, const SlicePoints* points,
                                      TaskPool* pool) {
  LUMIFOLD_CHECK(!features.empty() && params.height >= 1 && params.height <= 8 &&
                 params.pca_iterations >= 1 && params.sigma_s > 0 && reach > 0);
  LUMIFOLD_CHECK(!params.is_first_order || signals.size() == 3);
  LUMIFOLD_CHECK(
      points == nullptr ||
      (points->own_features <= features.size() &&
       points->features.size() == points->pixels.size() * points->own_features &&
       (points->signals.empty() || (points->signals.size() == points->pixels.size() * signals.size() &&
                                    points->weights.size() == points->pixels.size()))));
  LUMIFOLD_CHECK(params.cell >= 0 && params.cell <= kBandRows && (params.cell & (params.cell - 1)) == 0);
  if (mask.width() == 0 || mask.height() == 0)
    return {MakePlanes(signals.size(), mask.width(), mask.height()), {}};
  if (FilterDevice* const device = DeviceOf(pool)) {
    const ManifoldCall call = {ViewsOf(signals), {}, ViewsOf(features), mask, params, reach, points};
    if (auto result = device->Filter(call)) return *std::move(result);
  }
  return Filter(signals, features, mask, params, reach, points, pool).Run();
}

Planes ManifoldFilter(const Planes& signals, const Planes& features, ConstFloatView mask,
                      const ManifoldParams& params, TaskPool* pool) {
  return ManifoldFilterAtPoints(signals, features, mask, params, params.sigma_s, nullptr, pool).filtered;
}

}  // namespace lumifold::filter
