#include "filter/opencl/manifold_run.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"
#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_constants.h"

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

int32_t Int(size_t count) { return static_cast<int32_t>(count); }

/// One filtering; its work is in the order of the members.
class ManifoldRun {
 public:
  ManifoldRun(const ManifoldCall& call, KernelRun* run)
      : call_(call),
        run_(*run),
        options_(KernelsOf(call)),
        lattice_(call.mask.width(), call.mask.height(), options_.step),
        grid_{lattice_.width, lattice_.height, lattice_.Columns(), lattice_.Rows(),
              Int(PointsOf(call).pixels.size())},
        pixels_(static_cast<size_t>(grid_.width) * static_cast<size_t>(grid_.height)),
        cells_(static_cast<size_t>(grid_.columns) * static_cast<size_t>(grid_.rows)),
        manifolds_((int32_t{1} << call.params.height) - 1) {}

  absl::StatusOr<ManifoldResult> Run() {
    UploadSites();
    GrowTree();
    const Buffer masks = SplatMasks();
    SplatBlurSlice(masks);
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
  size_t Sites() const { return pixels_ + static_cast<size_t>(grid_.points); }
  float InCells(float sigma) const { return sigma / static_cast<float>(lattice_.step); }

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

  /// The manifolds, the weights of sites on them and their sums; and what splits clusters.
  struct Tree {
    Buffer eta, weights, total;
    Buffer sums, axes;
  };

  void UploadSites();
  void GrowTree();
  /// The axes that split `count` clusters.
  void FindAxes(int32_t count, int32_t first);
  /// What sites weigh in splats.
  Buffer SplatMasks();
  void SplatBlurSlice(Buffer masks);
  void Splat(Buffer masks);
  absl::StatusOr<ManifoldResult> Results();

  const ManifoldCall& call_;
  KernelRun& run_;
  const KernelOptions options_;
  const Lattice lattice_;
  const Grid grid_;
  const size_t pixels_;
  const size_t cells_;
  const int32_t manifolds_;
  Buffer places_ = {}, signals_ = {}, features_ = {};
  Tree tree_ = {};
  Buffer psi_ = {}, result_ = {}, found_ = {};
};

void ManifoldRun::UploadSites() {
  std::vector<int32_t> places;
  for (const auto& [x, y] : Points().pixels) places.insert(places.end(), {x, y});
  places_ = Upload(places);
  const size_t channels = call_.signals.size();
  signals_ = Upload(call_.signals, [&](size_t c, size_t i) {
    return Points().signals.empty() ? 0.0f : Points().signals[i * channels + c];
  });
  const size_t own = Points().own_features;
  features_ = Upload(call_.features, [&](size_t k, size_t i) {
    const size_t shared = Features() - own;
    const auto [x, y] = Points().pixels[i];
    return k < shared ? call_.features[k].At(x, y) : Points().features[i * own + (k - shared)];
  });
}

void ManifoldRun::FindAxes(int32_t count, int32_t first) {
  const int32_t row_step = std::max(1, grid_.rows / kAxisRows);
  const auto rows = static_cast<size_t>((grid_.rows + row_step - 1) / row_step);
  const size_t entries = static_cast<size_t>(count) * (Features() * (Features() + 1) / 2 + 1);
  const Buffer row_sums = run_.Allocate(rows * entries * sizeof(double));
  const Buffer covariance = run_.Allocate(entries * sizeof(double));
  run_.Run("RowCovariance", rows * entries, {grid_, count, first, row_step, tree_.sums, tree_.eta, row_sums});
  run_.Run("Covariance", entries, {grid_, count, row_step, row_sums, covariance});
  run_.Run("Axis", static_cast<size_t>(count), {count, call_.params.pca_iterations, covariance, tree_.axes});
}

void ManifoldRun::GrowTree() {
  const size_t most_clusters = size_t{1} << (call_.params.height - 1);
  const size_t most_sums = most_clusters * cells_ * (Features() + 1);
  tree_ = {.eta = Floats(static_cast<size_t>(manifolds_) * cells_ * Features()),
           .weights = Floats(static_cast<size_t>(manifolds_) * Sites()),
           .total = Upload(std::vector<float>(Sites())),
           .sums = Floats(most_sums),
           .axes = Floats(most_clusters * Features())};
  const Buffer members = Upload(Packed(call_.mask));
  const Buffer masses = Upload(Packed(call_.mask));
  const Buffer labels = Upload(std::vector<int32_t>(pixels_));
  const Buffer low = Floats(most_sums);
  const float link = Exp(-kSqrt2 / InCells(call_.params.sigma_s));
  for (int32_t depth = 0; depth < call_.params.height; ++depth) {
    const int32_t count = int32_t{1} << depth;
    const int32_t first = count - 1;
    const int32_t parent = depth == 0 ? -1 : count / 2 - 1;
    const int32_t splits = depth + 1 < call_.params.height ? 1 : 0;
    const size_t images = static_cast<size_t>(count);
    const size_t planes = images * (Features() + 1);
    run_.Run("ClusterSums", images * cells_, {grid_, count, features_, labels, masses, tree_.sums});
    run_.Run("EvenRows", planes * static_cast<size_t>(grid_.rows), {grid_, count, link, tree_.sums, low});
    run_.Run("EvenColumns", planes * static_cast<size_t>(grid_.columns), {grid_, count, link, low});
    run_.Run("Heights", images * cells_, {grid_, count, first, parent, low, tree_.eta});
    if (splits != 0) FindAxes(count, first);
    run_.Run(
        "Weigh", Sites(),
        {grid_, count, first, splits, Int(Features() - Points().own_features), Points().pixel_divisor,
         places_, features_, tree_.eta, tree_.axes, members, labels, tree_.total, tree_.weights, masses});
  }
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

void ManifoldRun::Splat(Buffer masks) {
  std::vector<std::vector<int32_t>> by_cell(cells_);
  std::vector<size_t> by_row(Points().pixels.size());
  std::iota(by_row.begin(), by_row.end(), size_t{0});
  std::stable_sort(by_row.begin(), by_row.end(),
                   [&](size_t i, size_t j) { return Points().pixels[i][1] < Points().pixels[j][1]; });
  for (const size_t i : by_row) {
    const auto [x, y] = Points().pixels[i];
    by_cell[static_cast<size_t>(y / lattice_.step) * static_cast<size_t>(grid_.columns) +
            static_cast<size_t>(x / lattice_.step)]
        .push_back(Int(i));
  }
  std::vector<int32_t> firsts = {0}, order;
  for (const std::vector<int32_t>& of_cell : by_cell) {
    order.insert(order.end(), of_cell.begin(), of_cell.end());
    firsts.push_back(Int(order.size()));
  }
  run_.Run("Splat", static_cast<size_t>(manifolds_) * cells_,
           {grid_, manifolds_, call_.reach, places_, Upload(firsts), Upload(order), signals_, masks,
            tree_.weights, psi_});
}

void ManifoldRun::SplatBlurSlice(Buffer masks) {
  const auto manifolds = static_cast<size_t>(manifolds_);
  const size_t all_cells = manifolds * cells_;
  psi_ = Floats(all_cells * Planes());
  result_ = Floats(Sites() * static_cast<size_t>(options_.channels));
  found_ = Floats(static_cast<size_t>(grid_.points));
  Splat(masks);
  if (options_.fits) run_.Run("Moments", all_cells, {grid_, manifolds_, psi_});
  const float sigma = InCells(call_.reach);
  const float stretch = (sigma / kBlurRange) * (sigma / kBlurRange);
  const Buffer across = Floats(all_cells);
  const Buffer down = Floats(all_cells);
  run_.Run("Links", all_cells, {grid_, manifolds_, sigma, stretch, tree_.eta, across, down});
  run_.Run("GuidedRows", manifolds * static_cast<size_t>(grid_.rows) * Planes(),
           {grid_, manifolds_, across, psi_});
  run_.Run("GuidedColumns", manifolds * static_cast<size_t>(grid_.columns) * Planes(),
           {grid_, manifolds_, down, psi_});
  run_.Run("Slice", Sites(),
           {grid_, manifolds_, call_.reach, call_.params.slope_ridge, places_, signals_, tree_.weights, psi_,
            result_, found_});
}

absl::StatusOr<ManifoldResult> ManifoldRun::Results() {
  const auto channels = static_cast<size_t>(options_.channels);
  ManifoldResult result{MakeUninitializedPlanes(channels, grid_.width, grid_.height), {}};
  const auto count = static_cast<size_t>(grid_.points);
  result.points = {std::vector<float>(count * channels), std::vector<float>(count)};
  std::vector<float> values(Sites());
  for (size_t c = 0; c < channels; ++c) {
    const size_t bytes = Sites() * sizeof(float);
    if (absl::Status status = run_.Read(result_, c * bytes, bytes, values.data()); !status.ok())
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

absl::StatusOr<ManifoldResult> RunManifolds(const ManifoldCall& call, KernelRun* run) {
  return ManifoldRun(call, run).Run();
}

}  // namespace lumifold::filter
