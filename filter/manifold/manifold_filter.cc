#include "filter/manifold/manifold_filter.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "filter/manifold/first_order.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/manifold/points.h"
#include "filter/manifold/recursive.h"
#include "filter/manifold/slice.h"
#include "filter/manifold/splat.h"

// The tree is walked level by level, so that full-resolution planes are read twice for each level and not
// twice for each manifold. Work at full resolution is per pixel: distance to the manifolds, splat into the
// pixel's own cell, slice. All recursion is on cells.
namespace lumifold::filter {
namespace {

/// Takes pixels whose points have weight out of the splats.
void LeaveToPoints(const SlicePoints& points, Plane* mask) {
  for (size_t i = 0; i < points.weights.size(); ++i) {
    const auto [x, y] = points.pixels[i / points.samples];
    if (points.weights[i] > 0) mask->At(x, y) = 0;
  }
}

PixelState MakeState(const Planes& signals, const Planes& features, ConstFloatView mask,
                     const ManifoldParams& params, const SlicePoints* points, TaskPool* pool) {
  const int width = mask.width();
  const int height = mask.height();
  const auto plane = [&] { return Plane::Uninitialized(width, height); };
  const size_t manifolds = size_t{1} << (params.height - 1);
  PixelState state{.signals = signals,
                   .features = features,
                   .mask = plane(),
                   .lattice = Lattice(width, height, CellOf(params)),
                   .widening = Widening(CellOf(params)),
                   .members = plane(),
                   .labels = plane(),
                   .next_labels = plane(),
                   .weights = MakeUninitializedPlanes(manifolds, width, height)};
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      std::copy_n(mask.Row(y), width, state.mask.Row(y));
      std::copy_n(mask.Row(y), width, state.members.Row(y));
      std::fill_n(state.labels.Row(y), width, 0.0f);
    }
  });
  if (points != nullptr && !points->signals.empty()) LeaveToPoints(*points, &state.mask);
  return state;
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

class Filter {
 public:
  /// `point_signals`: those of the points, as many channels as the state has; empty: points are read only.
  Filter(PixelState state, const ManifoldParams& params, float reach, const SlicePoints* points,
         std::vector<float> point_signals, TaskPool* pool)
      : state_(std::move(state)),
        params_(params),
        reach_(reach),
        slice_points_(points),
        point_signals_(std::move(point_signals)),
        pool_(pool) {
    const size_t signals = params.is_first_order ? kMoments : state_.signals.size();
    result_.filtered = MakeUninitializedPlanes(signals + 1, state_.lattice.width, state_.lattice.height);
    if (points == nullptr) return;
    points_.emplace(*points, state_.features, state_.lattice);
    const size_t count = points->pixels.size() * points->samples;
    result_.points = {std::vector<float>(count * signals), std::vector<float>(count)};
  }

  ManifoldResult Run() {
    const float sigma_cells = InCells(params_.sigma_s);
    std::vector<Manifold> manifolds;
    manifolds.push_back(MakeManifold(RootSums(), nullptr, sigma_cells, AxisSteps(1), pool_));
    for (int depth = 1;; ++depth) {
      Level level = Splat(std::move(manifolds), depth == params_.height);
      std::vector<ClusterSums> children = std::move(level.children);
      std::vector<Manifold> parents = BlurAndSlice(std::move(level), depth == 1);
      if (depth == params_.height) break;
      manifolds = std::vector<Manifold>(children.size());
      ParallelFor(pool_, static_cast<int64_t>(children.size()), [&](int64_t i) {
        const size_t at = static_cast<size_t>(i);
        manifolds[at] = MakeManifold(std::move(children[at]), &parents[at / 2].eta, sigma_cells,
                                     AxisSteps(depth + 1), pool_);
      });
    }
    DivideSums();
    DividePoints();
    if (params_.is_first_order) FitPlanes();
    return std::move(result_);
  }

 private:
  float InCells(float sigma) const { return sigma / static_cast<float>(state_.lattice.step); }
  /// Clusters of the last level are not split: they need no axis.
  int AxisSteps(int depth) const { return depth < params_.height ? params_.pca_iterations : 0; }
  ClusterSums RootSums() const;
  Level Splat(std::vector<Manifold> manifolds, bool is_last);
  /// Consumes the level's splats; gives back its manifolds.
  std::vector<Manifold> BlurAndSlice(Level level, bool is_first);
  /// Adds w * Psi of each manifold to the result; to nothing yet at the first level.
  void Slice(const std::vector<Planes>& psi, bool is_first);
  void DivideSums();
  void DividePoints();
  void FitPlanes();

  PixelState state_;
  const ManifoldParams params_;
  const float reach_;  // px
  const SlicePoints* const slice_points_;
  std::optional<Points> points_;
  const std::vector<float> point_signals_;
  TaskPool* const pool_;
  PointWeights point_weights_;  // of the current level
  ManifoldResult result_;       // sums of w * Psi until all manifolds are in, the weight's after the signals'
};

ClusterSums Filter::RootSums() const {
  ClusterSums sums = MakeClusterSums(state_.features.size(), state_.lattice);
  ParallelFor(pool_, state_.lattice.Rows(),
              [&](int64_t row) { RootCellRow(state_, static_cast<int>(row), &sums); });
  return sums;
}

Level Filter::Splat(std::vector<Manifold> manifolds, bool is_last) {
  const Lattice& lattice = state_.lattice;
  Level level;
  level.manifolds = std::move(manifolds);
  for (size_t i = 0; i < level.manifolds.size(); ++i) {
    level.splats.push_back(
        MakeUninitializedPlanes(state_.signals.size() + 1, lattice.Columns(), lattice.Rows()));
    for (int child = 0; child < 2 && !is_last; ++child)
      level.children.push_back(MakeClusterSums(state_.features.size(), lattice));
  }
  ForEachBand(pool_, lattice.height, [&](int, int y0, int y1) {
    StripSplat task(&state_, &level);  // kBandRows is a multiple of the step: bands share no cells
    for (int row = y0 / lattice.step; row * lattice.step < y1; ++row) task.CellRow(row);
  });
  std::swap(state_.labels, state_.next_labels);
  if (points_.has_value()) point_weights_ = points_->Weigh(level.manifolds, pool_);
  if (!point_signals_.empty()) points_->Splat(point_signals_, point_weights_, pool_, &level.splats);
  return level;
}

std::vector<Manifold> Filter::BlurAndSlice(Level level, bool is_first) {
  std::vector<Planes> psi(level.splats.size());
  ParallelFor(pool_, static_cast<int64_t>(psi.size()), [&](int64_t i) {
    const size_t at = static_cast<size_t>(i);
    if (params_.is_first_order) AddMoments(&level.splats[at]);
    psi[at] = GuidedLowPass(InCells(reach_), kBlurRange, level.manifolds[at].eta, level.splats[at], pool_);
    level.splats[at].clear();
  });
  Slice(psi, is_first);
  return std::move(level.manifolds);
}

void Filter::Slice(const std::vector<Planes>& psi, bool is_first) {
  ForEachBand(pool_, state_.lattice.height, [&](int, int y0, int y1) {
    StripSlice slice(state_, psi);
    for (int y = y0; y < y1; ++y) {
      for (Plane& sums : result_.filtered) {
        if (is_first) std::fill_n(sums.Row(y), sums.width(), 0.0f);
      }
      slice.PixelRow(y, &result_.filtered);
    }
  });
  if (points_.has_value()) points_->Slice(psi, point_weights_, pool_, &result_.points);
}

void Filter::DivideSums() {
  Planes& sums = result_.filtered;
  // Where all moments are 0, the fit gives the pixel's own light.
  const std::vector<float> no_moment(static_cast<size_t>(state_.lattice.width));
  ForEachBand(pool_, state_.lattice.height, [&](int, int y0, int y1) {
    for (size_t c = 0; c + 1 < sums.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* lost = c < state_.signals.size() ? state_.signals[c].Row(y) : no_moment.data();
        QuotientRow(sums.back().Row(y), kLeastWeight, lost, state_.lattice.width, sums[c].Row(y));
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
  result_.filtered = FitLight(result_.filtered, reach_, params_.slope_ridge, pool_);
  if (slice_points_ == nullptr) return;
  result_.points = FitLightAtPoints(*slice_points_, result_.points, reach_, params_.slope_ridge,
                                    state_.lattice.width, state_.lattice.height);
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
  const bool has_signals = points != nullptr && !points->signals.empty();
  if (!params.is_first_order) {
    return Filter(MakeState(signals, features, mask, params, points, pool), params, reach, points,
                  has_signals ? points->signals : std::vector<float>{}, pool)
        .Run();
  }
  const Planes with_position = WithPosition(signals, reach, pool);
  return Filter(MakeState(with_position, features, mask, params, points, pool), params, reach, points,
                has_signals ? PointSignalsWithPosition(*points, with_position) : std::vector<float>{}, pool)
      .Run();
}

Planes ManifoldFilter(const Planes& signals, const Planes& features, ConstFloatView mask,
                      const ManifoldParams& params, TaskPool* pool) {
  return ManifoldFilterAtPoints(signals, features, mask, params, params.sigma_s, nullptr, pool).filtered;
}

}  // namespace lumifold::filter
