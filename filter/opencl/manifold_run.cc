#include "filter/opencl/manifold_run.h"

#include <algorithm>
#include <cmath>
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
        grid_{lattice_.width, lattice_.height, lattice_.Columns(), lattice_.Rows()},
        pixels_(static_cast<size_t>(grid_.width) * static_cast<size_t>(grid_.height)),
        cells_(static_cast<size_t>(grid_.columns) * static_cast<size_t>(grid_.rows)),
        manifolds_((int32_t{1} << call.params.height) - 1) {}

  absl::StatusOr<ManifoldResult> Run() {
    signals_ = Upload(call_.signals);
    features_ = Upload(call_.features);
    GrowTree();
    splat_masks_ = SplatMasks();
    if (call_.points != nullptr) WeighPoints();
    SplatBlurSlice();
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    return Results();
  }

 private:
  size_t Features() const { return static_cast<size_t>(options_.features); }
  size_t Planes() const { return static_cast<size_t>(options_.planes()); }
  bool HasPointSignals() const { return call_.points != nullptr && !call_.points->signals.empty(); }
  float InCells(float sigma) const { return sigma / static_cast<float>(lattice_.step); }

  Buffer Floats(size_t count) { return run_.Allocate(count * sizeof(float)); }
  template <typename T>
  Buffer Upload(const std::vector<T>& values) {
    const Buffer buffer = run_.Allocate(values.size() * sizeof(T));
    run_.Write(buffer, 0, values.data(), values.size() * sizeof(T));
    return buffer;
  }
  Buffer Upload(const std::vector<Plane>& planes) {
    const Buffer buffer = Floats(planes.size() * pixels_);
    for (size_t k = 0; k < planes.size(); ++k) {
      const std::vector<float> values = Packed(planes[k].view());
      run_.Write(buffer, k * pixels_ * sizeof(float), values.data(), pixels_ * sizeof(float));
    }
    return buffer;
  }
  std::vector<float> Packed(ConstFloatView plane) const {
    std::vector<float> values;
    values.reserve(pixels_);
    for (int y = 0; y < plane.height(); ++y)
      values.insert(values.end(), plane.Row(y), plane.Row(y) + plane.width());
    return values;
  }

  /// The manifolds, the weights of pixels on them and their sums; and what splits clusters.
  struct Tree {
    Buffer eta, weights, total;
    Buffer sums, axes;
  };
  struct Points {
    int32_t count, samples;
    Buffer pixels, weights, masses;
    Buffer values, found;
  };

  void GrowTree();
  /// The axes that split `count` clusters.
  void FindAxes(int32_t count, int32_t first);
  Buffer SplatMasks();
  void WeighPoints();
  void SplatBlurSlice();
  void SplatPoints();
  absl::StatusOr<ManifoldResult> Results();

  const ManifoldCall& call_;
  KernelRun& run_;
  const KernelOptions options_;
  const Lattice lattice_;
  const Grid grid_;
  const size_t pixels_;
  const size_t cells_;
  const int32_t manifolds_;
  Buffer signals_ = {}, features_ = {};
  Tree tree_ = {};
  Buffer splat_masks_ = {}, psi_ = {}, result_ = {};
  Points points_ = {};
};

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
           .weights = Floats(static_cast<size_t>(manifolds_) * pixels_),
           .total = Upload(std::vector<float>(pixels_)),
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
    run_.Run("Weigh", pixels_,
             {grid_, count, first, splits, features_, tree_.eta, tree_.axes, members, labels, tree_.total,
              tree_.weights, masses});
  }
}

Buffer ManifoldRun::SplatMasks() {
  std::vector<float> masks = Packed(call_.mask);
  for (size_t i = 0; HasPointSignals() && i < call_.points->weights.size(); ++i) {
    const auto [x, y] = call_.points->pixels[i / call_.points->samples];
    if (call_.points->weights[i] > 0)  // the pixel's points stand for it
      masks[static_cast<size_t>(y) * static_cast<size_t>(grid_.width) + static_cast<size_t>(x)] = 0;
  }
  const Buffer buffer = Upload(masks);
  if (call_.params.keeps_mass) run_.Run("KeepMass", pixels_, {Int(pixels_), tree_.total, buffer});
  return buffer;
}

void ManifoldRun::WeighPoints() {
  const SlicePoints& points = *call_.points;
  const size_t count = points.pixels.size() * points.samples;
  std::vector<int32_t> pixels;
  for (const auto& [x, y] : points.pixels) pixels.insert(pixels.end(), {x, y});
  points_ = {.count = Int(count),
             .samples = Int(points.samples),
             .pixels = Upload(pixels),
             .weights = Floats(count * static_cast<size_t>(manifolds_)),
             .masses = Upload(points.weights),
             .values = Floats(count * static_cast<size_t>(options_.channels)),
             .found = Floats(count)};
  const Buffer total = Floats(count);
  run_.Run("WeighPoints", count,
           {grid_, points_.count, points_.samples, manifolds_, Int(points.own_features), points.pixel_divisor,
            points_.pixels, features_, Upload(points.features), tree_.eta, points_.weights, total});
  if (call_.params.keeps_mass && HasPointSignals())
    run_.Run("KeepMass", count, {points_.count, total, points_.masses});
}

void ManifoldRun::SplatPoints() {
  const SlicePoints& points = *call_.points;
  std::vector<std::vector<int32_t>> by_cell(cells_);
  for (size_t i = 0; i < points.pixels.size(); ++i) {
    const auto [x, y] = points.pixels[i];
    auto& cell = by_cell[static_cast<size_t>(y / lattice_.step) * static_cast<size_t>(grid_.columns) +
                         static_cast<size_t>(x / lattice_.step)];
    for (size_t j = 0; j < points.samples; ++j) cell.push_back(Int(i * points.samples + j));
  }
  std::vector<int32_t> cells, firsts = {0}, order;
  for (size_t i = 0; i < cells_; ++i) {
    if (by_cell[i].empty()) continue;
    cells.push_back(Int(i));
    order.insert(order.end(), by_cell[i].begin(), by_cell[i].end());
    firsts.push_back(Int(order.size()));
  }
  run_.Run("SplatPoints", cells.size() * static_cast<size_t>(manifolds_),
           {grid_, points_.count, points_.samples, manifolds_, Int(cells.size()), call_.reach, points_.pixels,
            Upload(points.signals), points_.masses, points_.weights, Upload(cells), Upload(firsts),
            Upload(order), psi_});
}

void ManifoldRun::SplatBlurSlice() {
  const auto manifolds = static_cast<size_t>(manifolds_);
  const size_t all_cells = manifolds * cells_;
  psi_ = Floats(all_cells * Planes());
  result_ = Floats(pixels_ * static_cast<size_t>(options_.channels));
  run_.Run("Splat", all_cells, {grid_, manifolds_, call_.reach, signals_, splat_masks_, tree_.weights, psi_});
  if (HasPointSignals()) SplatPoints();
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
  run_.Run(
      "Slice", pixels_,
      {grid_, manifolds_, call_.reach, call_.params.slope_ridge, signals_, tree_.weights, psi_, result_});
  if (call_.points == nullptr) return;
  run_.Run("SliceAtPoints", static_cast<size_t>(points_.count),
           {grid_, points_.count, points_.samples, manifolds_, call_.reach, call_.params.slope_ridge,
            points_.pixels, points_.weights, psi_, points_.values, points_.found});
}

absl::StatusOr<ManifoldResult> ManifoldRun::Results() {
  const auto channels = static_cast<size_t>(options_.channels);
  ManifoldResult result{MakeUninitializedPlanes(channels, grid_.width, grid_.height), {}};
  std::vector<float> values(pixels_);
  for (size_t c = 0; c < channels; ++c) {
    const size_t bytes = pixels_ * sizeof(float);
    if (absl::Status status = run_.Read(result_, c * bytes, bytes, values.data()); !status.ok())
      return status;
    const auto width = static_cast<size_t>(grid_.width);
    for (int y = 0; y < grid_.height; ++y)
      std::copy_n(values.data() + static_cast<size_t>(y) * width, width, result.filtered[c].Row(y));
  }
  if (call_.points == nullptr) return result;
  const auto count = static_cast<size_t>(points_.count);
  result.points = {std::vector<float>(count * channels), std::vector<float>(count)};
  absl::Status read =
      run_.Read(points_.values, 0, count * channels * sizeof(float), result.points.values.data());
  if (read.ok()) read = run_.Read(points_.found, 0, count * sizeof(float), result.points.weights.data());
  if (!read.ok()) return read;
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
