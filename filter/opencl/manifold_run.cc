#include "filter/opencl/manifold_run.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/opencl/memory_plan.h"

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

int32_t Int(size_t count) { return static_cast<int32_t>(count); }

/// One filtering; its work is in the order of the members.
class ManifoldRun {
 public:
  ManifoldRun(const ManifoldCall& call, const DeviceMemory& memory, KernelRun* run)
      : call_(call),
        run_(*run),
        sizes_(call),
        options_(sizes_.options),
        grid_(sizes_.grid),
        pixels_(sizes_.pixels),
        cells_(sizes_.cells),
        plan_(PlanFor(memory, sizes_)) {}

  absl::StatusOr<ManifoldResult> Run() {
    UploadFeatures();
    GrowTree();
    // What is released counts until its work has ended.
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    UploadSignals();
    SplatBlurSlice(SplatMasks());
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    return Results();
  }

 private:
  size_t Features() const { return static_cast<size_t>(options_.features); }
  size_t Planes() const { return static_cast<size_t>(options_.planes()); }
  /// No points where the call has none.
  static const SlicePoints& PointsOf(const ManifoldCall& call) {
    static const SlicePoints none;
    return call.points != nullptr ? *call.points : none;
  }
  const SlicePoints& Points() const { return PointsOf(call_); }
  size_t Sites() const { return sizes_.sites; }
  /// Whether all manifolds take one turn.
  bool IsWhole() const { return plan_.manifolds == sizes_.manifolds; }
  float InCells(float sigma) const { return sigma / static_cast<float>(options_.step); }

  Buffer Floats(size_t count) { return run_.Allocate(count * sizeof(float)); }
  template <typename T>
  Buffer Upload(const std::vector<T>& values) {
    const Buffer buffer = run_.Allocate(values.size() * sizeof(T));
    run_.Write(buffer, 0, values.data(), values.size() * sizeof(T));
    return buffer;
  }
  /// Planes of sites: those of pixels, and value(k, i) for plane k of point i.
  template <typename Value>
  Buffer Upload(const std::vector<Plane>& planes, const Value& value) {
    const Buffer buffer = Floats(planes.size() * Sites());
    for (size_t k = 0; k < planes.size(); ++k) {
      std::vector<float> values = Packed(planes[k].view());
      for (size_t i = 0; i < Points().pixels.size(); ++i) values.push_back(value(k, i));
      run_.Write(buffer, k * Sites() * sizeof(float), values.data(), Sites() * sizeof(float));
    }
    return buffer;
  }
  std::vector<float> Packed(ConstFloatView plane) const {
    std::vector<float> values;
    values.reserve(Sites());
    for (int y = 0; y < plane.height(); ++y)
      values.insert(values.end(), plane.Row(y), plane.Row(y) + plane.width());
    return values;
  }

  /// The manifolds, the weights of sites on those of a turn and the sums of all; and what splits clusters.
  struct Tree {
    Buffer eta, weights, total;
    Buffer sums, low, axes;
    Buffer members, masses, labels;
  };
  /// The points by cells, as kernel Splat has them.
  struct PointOrder {
    Buffer firsts, order;
  };

  void UploadFeatures();
  void UploadSignals();
  void GrowTree();
  /// `count` manifolds from `first` on, of a level of `level` manifolds.
  void GrowClusters(int32_t level, int32_t first, int32_t count, bool splits);
  /// The axes that split `count` clusters of a level from cluster `cluster` on.
  void FindAxes(int32_t count, int32_t first, int32_t cluster);
  /// Weights that stay are kept from manifold `origin` on.
  void Weigh(int32_t count, int32_t first, bool stays, int32_t origin, bool splits);
  /// What sites weigh in splats.
  Buffer SplatMasks();
  PointOrder OrderPoints();
  void SplatBlurSlice(Buffer masks);
  void Blur(int32_t count, int32_t first);
  absl::StatusOr<ManifoldResult> Results();

  const ManifoldCall& call_;
  KernelRun& run_;
  const ManifoldSizes sizes_;
  const KernelOptions options_;
  const Grid grid_;
  const size_t pixels_;
  const size_t cells_;
  const MemoryPlan plan_;
  Buffer places_ = {}, signals_ = {}, features_ = {};
  Tree tree_ = {};
  Buffer psi_ = {}, across_ = {}, down_ = {};
  Buffer planes_ = {};  // sums over manifolds, and then the result
  Buffer found_ = {};
};

void ManifoldRun::UploadFeatures() {
  std::vector<int32_t> places;
  for (const auto& [x, y] : Points().pixels) places.insert(places.end(), {x, y});
  places_ = Upload(places);
  const size_t own = Points().own_features;
  features_ = Upload(call_.features, [&](size_t k, size_t i) {
    const size_t shared = Features() - own;
    const auto [x, y] = Points().pixels[i];
    return k < shared ? call_.features[k].At(x, y) : Points().features[i * own + (k - shared)];
  });
}

void ManifoldRun::UploadSignals() {
  const size_t channels = call_.signals.size();
  signals_ = Upload(call_.signals, [&](size_t c, size_t i) {
    return Points().signals.empty() ? 0.0f : Points().signals[i * channels + c];
  });
}

void ManifoldRun::FindAxes(int32_t count, int32_t first, int32_t cluster) {
  const int32_t row_step = std::max(1, grid_.rows / kAxisRows);
  const auto rows = static_cast<size_t>((grid_.rows + row_step - 1) / row_step);
  const size_t entries = static_cast<size_t>(count) * (Features() * (Features() + 1) / 2 + 1);
  const Buffer row_sums = run_.Allocate(rows * entries * sizeof(double));
  const Buffer covariance = run_.Allocate(entries * sizeof(double));
  run_.Run("RowCovariance", rows * entries, {grid_, count, first, row_step, tree_.sums, tree_.eta, row_sums});
  run_.Run("Covariance", entries, {grid_, count, row_step, row_sums, covariance});
  run_.Run("Axis", static_cast<size_t>(count),
           {count, cluster, call_.params.pca_iterations, covariance, tree_.axes});
  for (const Buffer buffer : {row_sums, covariance}) run_.Release(buffer);
}

void ManifoldRun::Weigh(int32_t count, int32_t first, bool stays, int32_t origin, bool splits) {
  run_.Run("Weigh", Sites(),
           {grid_, count, first, stays ? 1 : 0, origin, splits ? 1 : 0,
            Int(Features() - Points().own_features), Points().pixel_divisor, places_, features_, tree_.eta,
            tree_.axes, tree_.members, tree_.labels, tree_.total, tree_.weights, tree_.masses});
}

void ManifoldRun::GrowClusters(int32_t level, int32_t first, int32_t count, bool splits) {
  const auto images = static_cast<size_t>(count);
  const size_t planes = images * (Features() + 1);
  const float link = Exp(-kSqrt2 / InCells(call_.params.sigma_s));
  const int32_t cluster = first - (level - 1);
  const int32_t parent = level == 1 ? -1 : level / 2 - 1 + cluster / 2;
  run_.Run("ClusterSums", images * cells_,
           {grid_, count, cluster, features_, tree_.labels, tree_.masses, tree_.sums});
  run_.Run("EvenRows", planes * static_cast<size_t>(grid_.rows), {grid_, count, link, tree_.sums, tree_.low});
  run_.Run("EvenColumns", planes * static_cast<size_t>(grid_.columns), {grid_, count, link, tree_.low});
  run_.Run("Heights", images * cells_, {grid_, count, first, parent, tree_.low, tree_.eta});
  if (splits) FindAxes(count, first, cluster);
}

void ManifoldRun::GrowTree() {
  const size_t most_clusters = size_t{1} << (sizes_.levels - 1);
  const size_t sums = static_cast<size_t>(plan_.clusters) * cells_ * (Features() + 1);
  tree_ = {.eta = Floats(static_cast<size_t>(sizes_.manifolds) * cells_ * Features()),
           .weights = Floats(IsWhole() ? static_cast<size_t>(sizes_.manifolds) * Sites() : 0),
           .total = Upload(std::vector<float>(Sites())),
           .sums = Floats(sums),
           .low = Floats(sums),
           .axes = Floats(most_clusters * Features()),
           .members = Upload(Packed(call_.mask)),
           .masses = Upload(Packed(call_.mask)),
           .labels = Upload(std::vector<int32_t>(pixels_))};
  for (int32_t level = 1; level <= Int(most_clusters); level *= 2) {
    const int32_t first = level - 1;
    const bool splits = level < Int(most_clusters);
    const int32_t turn = std::min(level, plan_.clusters);
    for (int32_t cluster = 0; cluster < level; cluster += turn)
      GrowClusters(level, first + cluster, turn, splits);
    Weigh(level, first, IsWhole(), 0, splits);
  }
  for (const Buffer buffer : {tree_.sums, tree_.low, tree_.members, tree_.masses, tree_.labels})
    run_.Release(buffer);
  tree_.members = tree_.masses = tree_.labels = tree_.total;  // of kernels that do not read them
  if (IsWhole()) run_.Release(features_);
}

Buffer ManifoldRun::SplatMasks() {
  std::vector<float> masks = Packed(call_.mask);
  masks.resize(Sites(), 0.0f);
  for (size_t i = 0; !Points().signals.empty() && i < Points().weights.size(); ++i) {
    masks[pixels_ + i] = Points().weights[i];
    const auto [x, y] = Points().pixels[i];
    if (Points().weights[i] > 0)  // the pixel's points stand for it
      masks[static_cast<size_t>(y) * static_cast<size_t>(grid_.width) + static_cast<size_t>(x)] = 0;
  }
  const Buffer buffer = Upload(masks);
  if (call_.params.keeps_mass) run_.Run("KeepMass", Sites(), {grid_, tree_.total, buffer});
  return buffer;
}

ManifoldRun::PointOrder ManifoldRun::OrderPoints() {
  std::vector<std::vector<int32_t>> by_cell(cells_);
  std::vector<size_t> by_row(Points().pixels.size());
  std::iota(by_row.begin(), by_row.end(), size_t{0});
  std::stable_sort(by_row.begin(), by_row.end(),
                   [&](size_t i, size_t j) { return Points().pixels[i][1] < Points().pixels[j][1]; });
  for (const size_t i : by_row) {
    const auto [x, y] = Points().pixels[i];
    by_cell[static_cast<size_t>(y / options_.step) * static_cast<size_t>(grid_.columns) +
            static_cast<size_t>(x / options_.step)]
        .push_back(Int(i));
  }
  std::vector<int32_t> firsts = {0}, order;
  for (const std::vector<int32_t>& of_cell : by_cell) {
    order.insert(order.end(), of_cell.begin(), of_cell.end());
    firsts.push_back(Int(order.size()));
  }
  return {Upload(firsts), Upload(order)};
}

void ManifoldRun::Blur(int32_t count, int32_t first) {
  const auto images = static_cast<size_t>(count);
  const float sigma = InCells(call_.reach);
  const float stretch = (sigma / kBlurRange) * (sigma / kBlurRange);
  run_.Run("Links", images * cells_, {grid_, count, first, sigma, stretch, tree_.eta, across_, down_});
  run_.Run("GuidedRows", images * static_cast<size_t>(grid_.rows) * Planes(), {grid_, count, across_, psi_});
  run_.Run("GuidedColumns", images * static_cast<size_t>(grid_.columns) * Planes(),
           {grid_, count, down_, psi_});
}

void ManifoldRun::SplatBlurSlice(Buffer masks) {
  const PointOrder points = OrderPoints();
  const auto most = static_cast<size_t>(plan_.manifolds);
  if (!IsWhole()) tree_.weights = Floats(most * Sites());
  psi_ = Floats(most * cells_ * Planes());
  across_ = Floats(most * cells_);
  down_ = Floats(most * cells_);
  planes_ = Floats(Sites() * (IsWhole() ? static_cast<size_t>(options_.channels) : Planes()));
  found_ = Floats(static_cast<size_t>(grid_.points));
  for (int32_t first = 0; first < sizes_.manifolds; first += plan_.manifolds) {
    const int32_t count = std::min(plan_.manifolds, sizes_.manifolds - first);
    const size_t images = static_cast<size_t>(count);
    if (!IsWhole()) Weigh(count, first, /*stays=*/true, /*origin=*/first, /*splits=*/false);
    run_.Run("Splat", images * cells_,
             {grid_, count, call_.reach, places_, points.firsts, points.order, signals_, masks, tree_.weights,
              psi_});
    if (options_.fits) run_.Run("Moments", images * cells_, {grid_, count, psi_});
    Blur(count, first);
    run_.Run("Slice", Sites(),
             {grid_, count, first == 0 ? 1 : 0, first + count == sizes_.manifolds ? 1 : 0, call_.reach,
              call_.params.slope_ridge, places_, signals_, tree_.weights, psi_, planes_, found_});
  }
}

absl::StatusOr<ManifoldResult> ManifoldRun::Results() {
  const auto channels = static_cast<size_t>(options_.channels);
  ManifoldResult result{MakeUninitializedPlanes(channels, grid_.width, grid_.height), {}};
  const auto count = static_cast<size_t>(grid_.points);
  result.points = {std::vector<float>(count * channels), std::vector<float>(count)};
  std::vector<float> values(Sites());
  for (size_t c = 0; c < channels; ++c) {
    const size_t bytes = Sites() * sizeof(float);
    if (absl::Status status = run_.Read(planes_, c * bytes, bytes, values.data()); !status.ok())
      return status;
    const auto width = static_cast<size_t>(grid_.width);
    for (int y = 0; y < grid_.height; ++y)
      std::copy_n(values.data() + static_cast<size_t>(y) * width, width, result.filtered[c].Row(y));
    for (size_t i = 0; i < count; ++i) result.points.values[i * channels + c] = values[pixels_ + i];
  }
  if (absl::Status status = run_.Read(found_, 0, count * sizeof(float), result.points.weights.data());
      !status.ok())
    return status;
  return result;
}

}  // namespace

KernelOptions KernelsOf(const ManifoldCall& call) {
  return {static_cast<int>(call.features.size()), static_cast<int>(call.signals.size()),
          call.params.is_first_order, CellOf(call.params)};
}

DeviceMemory LeastMemory(const ManifoldCall& call) {
  const ManifoldSizes sizes(call);
  return NeedOf(LeastPlan(sizes), sizes);
}

DeviceMemory TakenMemory(const ManifoldCall& call, const DeviceMemory& memory) {
  const ManifoldSizes sizes(call);
  return NeedOf(PlanFor(memory, sizes), sizes);
}

absl::StatusOr<ManifoldResult> RunManifolds(const ManifoldCall& call, const DeviceMemory& memory,
                                            KernelRun* run) {
  return ManifoldRun(call, memory, run).Run();
}

}  // namespace lumifold::filter
