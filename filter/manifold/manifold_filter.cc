#include "filter/manifold/manifold_filter.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "filter/manifold/first_order.h"
#include "filter/manifold/manifold_device.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/manifold/points.h"
#include "filter/manifold/recursive.h"
#include "filter/manifold/slice.h"
#include "filter/manifold/splat.h"
#include "filter/manifold/weigh.h"

// First the whole tree of manifolds, with the weights of pixels and points on each; then splat, blur and
// slice level by level, so that full-resolution planes are read once for each level. Work at full resolution
// is per pixel: distance to the manifolds, splat into the pixel's own cell, slice. All recursion is on cells.
namespace lumifold::filter {
namespace {

/// By what the mass of a pixel or point is divided that has this sum of weights.
float MassDivisor(float total) { return std::min(1.0f, total) + kLeastTotal; }

/// What pixels weigh in splats. Rows are ordered by phase.
Plane SplatMask(const Plane& mask, const Plane& total, const ManifoldParams& params,
                const SlicePoints* points, const Lattice& lattice, TaskPool* pool) {
  Plane splat = Plane::Uninitialized(mask.width(), mask.height());
  ForEachPixel(pool, mask.width(), mask.height(), [&](int x, int y) {
    const float divisor = params.keeps_mass ? MassDivisor(total.At(x, y)) : 1.0f;
    splat.At(x, y) = mask.At(x, y) / divisor;
  });
  if (points == nullptr || points->signals.empty()) return splat;
  for (size_t i = 0; i < points->weights.size(); ++i) {  // their points stand for them
    const auto [x, y] = points->pixels[i / points->samples];
    if (points->weights[i] > 0) splat.At(lattice.Place(x), y) = 0;
  }
  return splat;
}

/// Position of the points as further signals, channel by channel for each pixel.
std::vector<float> PointSignalsWithPosition(const SlicePoints& points, const Planes& with_position) {
  const size_t samples = points.samples;
  constexpr size_t kColors = kPlaneSignals - 2;
  std::vector<float> signals;
  signals.reserve(points.pixels.size() * kPlaneSignals * samples);
  for (size_t pixel = 0; pixel < points.pixels.size(); ++pixel) {
    const auto first = points.signals.begin() + static_cast<std::ptrdiff_t>(pixel * kColors * samples);
    signals.insert(signals.end(), first, first + static_cast<std::ptrdiff_t>(kColors * samples));
    const auto [x, y] = points.pixels[pixel];
    for (size_t c = kColors; c < kPlaneSignals; ++c)
      signals.insert(signals.end(), samples, with_position[c].At(x, y));
  }
  return signals;
}

/// A level of the tree, and the weights of the points on its manifolds.
struct WeighedLevel {
  Level level;
  PointWeights points;
};

Planes ByPhase(const Planes& planes, const Lattice& lattice, TaskPool* pool) {
  Planes by_phase;
  for (const Plane& plane : planes) by_phase.push_back(ByPhase(plane.view(), lattice, pool));
  return by_phase;
}

class Filter {
 public:
  /// `point_signals`: those of the points, as many channels as `signals` has; empty: points are read only.
  Filter(const Planes& signals, const Planes& features, ConstFloatView mask, const ManifoldParams& params,
         float reach, const SlicePoints* points, std::vector<float> point_signals, TaskPool* pool)
      : lattice_(mask.width(), mask.height(), CellOf(params)),
        phases_(CellOf(params)),
        signals_(ByPhase(signals, lattice_, pool)),
        features_(ByPhase(features, lattice_, pool)),
        mask_(ByPhase(mask, lattice_, pool)),
        params_(params),
        reach_(reach),
        slice_points_(points),
        point_signals_(std::move(point_signals)),
        pool_(pool) {
    const size_t results = params.is_first_order ? kMoments : signals.size();
    result_.filtered = MakeUninitializedPlanes(results + 1, lattice_.PhasedWidth(), lattice_.height);
    if (points == nullptr) return;
    points_.emplace(*points, features, lattice_);
    const size_t count = points->pixels.size() * points->samples;
    result_.points = {std::vector<float>(count * results), std::vector<float>(count)};
  }

  ManifoldResult Run() {
    std::vector<WeighedLevel> tree = BuildTree();
    for (WeighedLevel& at : tree) {
      const std::vector<Planes> psi = Blur(at.level, Splat(at));
      Slice(at, psi, /*is_first=*/&at == &tree.front());
      at = {};
    }
    DivideSums();
    DividePoints();
    if (params_.is_first_order) FitPlanes();
    for (Plane& plane : result_.filtered) plane = InOrder(plane, lattice_, pool_);
    return std::move(result_);
  }

 private:
  float InCells(float sigma) const { return sigma / static_cast<float>(lattice_.step); }
  /// Clusters of the last level are not split: they need no axis.
  int AxisSteps(int depth) const { return depth < params_.height ? params_.pca_iterations : 0; }
  ClusterSums RootSums(const Clusters& clusters) const;
  /// Also fills splat_mask_ and point_masses_.
  std::vector<WeighedLevel> BuildTree();
  WeighedLevel Weigh(std::vector<Manifold> manifolds, bool is_last, Clusters* clusters) const;
  std::vector<float> PointMasses(const std::vector<WeighedLevel>& tree) const;
  std::vector<Planes> Splat(const WeighedLevel& at) const;
  std::vector<Planes> Blur(const Level& level, std::vector<Planes> splats) const;
  /// Adds w * Psi of each manifold to the result; to nothing yet at the first level.
  void Slice(const WeighedLevel& at, const std::vector<Planes>& psi, bool is_first);
  void DivideSums();
  void DividePoints();
  void FitPlanes();

  const Lattice lattice_;
  const Phases phases_;
  const Planes signals_;  // these and all planes of pixels below: rows ordered by phase
  const Planes features_;
  const Plane mask_;
  const ManifoldParams params_;
  const float reach_;  // px
  const SlicePoints* const slice_points_;
  std::optional<Points> points_;
  const std::vector<float> point_signals_;
  TaskPool* const pool_;
  Plane splat_mask_;
  std::vector<float> point_masses_;  // what points weigh in splats
  ManifoldResult result_;  // sums of w * Psi until all manifolds are in, the weight's after the signals'
};

ClusterSums Filter::RootSums(const Clusters& clusters) const {
  ClusterSums sums = MakeClusterSums(features_.size(), lattice_);
  ParallelFor(pool_, lattice_.Rows(),
              [&](int64_t row) { RootCellRow(features_, lattice_, clusters, static_cast<int>(row), &sums); });
  return sums;
}

WeighedLevel Filter::Weigh(std::vector<Manifold> manifolds, bool is_last, Clusters* clusters) const {
  WeighedLevel at;
  Level& level = at.level;
  level.manifolds = std::move(manifolds);
  level.weights = MakeUninitializedPlanes(level.manifolds.size(), lattice_.PhasedWidth(), lattice_.height);
  for (size_t i = 0; i < 2 * level.manifolds.size() && !is_last; ++i)
    level.children.push_back(MakeClusterSums(features_.size(), lattice_));
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    StripWeigh task(features_, lattice_, phases_, clusters, &level);
    // kBandRows is a multiple of the step: bands share no cells
    for (int row = y0 / lattice_.step; row * lattice_.step < y1; ++row) task.CellRow(row);
  });
  std::swap(clusters->labels, clusters->next_labels);
  if (points_.has_value()) at.points = points_->Weigh(level.manifolds, pool_);
  return at;
}

std::vector<WeighedLevel> Filter::BuildTree() {
  const float sigma_cells = InCells(params_.sigma_s);
  Clusters clusters(mask_, pool_);
  std::vector<WeighedLevel> tree;
  std::vector<Manifold> manifolds;
  manifolds.push_back(MakeManifold(RootSums(clusters), nullptr, sigma_cells, AxisSteps(1), pool_));
  for (int depth = 1; depth <= params_.height; ++depth) {
    tree.push_back(Weigh(std::move(manifolds), depth == params_.height, &clusters));
    Level& level = tree.back().level;
    manifolds = std::vector<Manifold>(level.children.size());
    ParallelFor(pool_, static_cast<int64_t>(manifolds.size()), [&](int64_t i) {
      const auto at = static_cast<size_t>(i);
      manifolds[at] = MakeManifold(std::move(level.children[at]), &level.manifolds[at / 2].eta, sigma_cells,
                                   AxisSteps(depth + 1), pool_);
    });
  }
  splat_mask_ = SplatMask(mask_, clusters.total, params_, slice_points_, lattice_, pool_);
  if (!point_signals_.empty()) point_masses_ = PointMasses(tree);
  return tree;
}

std::vector<float> Filter::PointMasses(const std::vector<WeighedLevel>& tree) const {
  std::vector<float> masses = slice_points_->weights;
  for (size_t p = 0; p < masses.size() && params_.keeps_mass; ++p) {
    float total = 0;
    for (const WeighedLevel& at : tree) {
      const float* weights = at.points.values.data() + p * at.points.stride;
      for (size_t i = 0; i < at.level.manifolds.size(); ++i) total += weights[i];
    }
    masses[p] /= MassDivisor(total);
  }
  return masses;
}

std::vector<Planes> Filter::Splat(const WeighedLevel& at) const {
  std::vector<Planes> splats;
  for (size_t i = 0; i < at.level.manifolds.size(); ++i)
    splats.push_back(MakeUninitializedPlanes(signals_.size() + 1, lattice_.Columns(), lattice_.Rows()));
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    StripSplat task(signals_, splat_mask_, at.level.weights, lattice_, &splats);
    for (int row = y0 / lattice_.step; row * lattice_.step < y1; ++row) task.CellRow(row);
  });
  if (!point_signals_.empty()) points_->Splat(point_signals_, point_masses_, at.points, pool_, &splats);
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

void Filter::Slice(const WeighedLevel& at, const std::vector<Planes>& psi, bool is_first) {
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    StripSlice slice(at.level.weights, psi, lattice_, phases_);
    for (int y = y0; y < y1; ++y) slice.PixelRow(y, !is_first, &result_.filtered);
  });
  if (points_.has_value()) points_->Slice(psi, at.points, pool_, &result_.points);
}

void Filter::DivideSums() {
  Planes& sums = result_.filtered;
  // Where all moments are 0, the fit gives the pixel's own light.
  const std::vector<float> no_moment(static_cast<size_t>(lattice_.PhasedWidth()));
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    for (size_t c = 0; c + 1 < sums.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* lost = c < signals_.size() ? signals_[c].Row(y) : no_moment.data();
        QuotientRow(sums.back().Row(y), kLeastWeight, lost, lattice_.PhasedWidth(), sums[c].Row(y));
      }
    }
  });
  sums.pop_back();
}

void Filter::DividePoints() {
  SlicedPoints& points = result_.points;
  const size_t channels = result_.filtered.size();
  for (size_t i = 0; i < points.weights.size(); ++i) {
    const bool is_lost = points.weights[i] < kLeastWeight;
    const size_t first =
        i / slice_points_->samples * channels * slice_points_->samples + i % slice_points_->samples;
    for (size_t c = 0; c < channels; ++c) {
      float& value = points.values[first + c * slice_points_->samples];
      value = is_lost ? 0.0f : value / points.weights[i];
    }
    if (is_lost) points.weights[i] = 0;
  }
}

void Filter::FitPlanes() {
  result_.filtered = FitLight(result_.filtered, signals_[kPlaneSignals - 2], signals_[kPlaneSignals - 1],
                              params_.slope_ridge, pool_);
  if (slice_points_ == nullptr) return;
  result_.points = FitLightAtPoints(*slice_points_, result_.points, reach_, params_.slope_ridge,
                                    lattice_.width, lattice_.height);
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
  LUMIFOLD_CHECK(points == nullptr ||
                 (points->own_features <= features.size() &&
                  points->features.size() == points->pixels.size() * points->own_features * points->samples &&
                  (points->signals.empty() ||
                   (points->signals.size() == points->pixels.size() * signals.size() * points->samples &&
                    points->weights.size() == points->pixels.size() * points->samples))));
  LUMIFOLD_CHECK(params.cell >= 0 && params.cell <= kBandRows && (params.cell & (params.cell - 1)) == 0);
  if (mask.width() == 0 || mask.height() == 0)
    return {MakePlanes(signals.size(), mask.width(), mask.height()), {}};
  if (ManifoldDevice* const device = DeviceOf(pool)) {
    if (auto result = device->Filter({signals, features, mask, params, reach, points}))
      return *std::move(result);
  }
  const bool has_signals = points != nullptr && !points->signals.empty();
  if (!params.is_first_order) {
    return Filter(signals, features, mask, params, reach, points,
                  has_signals ? points->signals : std::vector<float>{}, pool)
        .Run();
  }
  const Planes with_position = WithPosition(signals, reach, pool);
  return Filter(with_position, features, mask, params, reach, points,
                has_signals ? PointSignalsWithPosition(*points, with_position) : std::vector<float>{}, pool)
      .Run();
}

Planes ManifoldFilter(const Planes& signals, const Planes& features, ConstFloatView mask,
                      const ManifoldParams& params, TaskPool* pool) {
  return ManifoldFilterAtPoints(signals, features, mask, params, params.sigma_s, nullptr, pool).filtered;
}

}  // namespace lumifold::filter
