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

/// One filtering; its work is in the order of the members. Leaves no memory behind.
class ManifoldRun {
 public:
  ManifoldRun(const SiteFiltering& call, const DeviceMemory& memory, KernelRun* run)
      : call_(call),
        run_(*run),
        sizes_(call.sizes),
        plan_(PlanFor(memory, sizes_)),
        own_({call.features, call.signals, call.masks}) {}
  ManifoldRun(const ManifoldRun&) = delete;
  ManifoldRun& operator=(const ManifoldRun&) = delete;
  ~ManifoldRun() {
    for (const Buffer buffer : own_) run_.Release(buffer);
  }

  absl::StatusOr<FilteredSites> Run() {
    // What is released counts until its work has ended.
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    GrowTree();
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    WeighSites();
    SplatBlurSlice();
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    return FilteredSites{blurred_.planes, blurred_.found};
  }

 private:
  size_t Features() const { return static_cast<size_t>(sizes_.options.features); }
  size_t Planes() const { return static_cast<size_t>(sizes_.options.planes()); }
  const SlicePoints& Points() const { return call_.points; }
  size_t Rows() const { return static_cast<size_t>(sizes_.grid.rows); }
  size_t Columns() const { return static_cast<size_t>(sizes_.grid.columns); }
  size_t PixelAt(const std::array<int, 2>& place) const {
    return static_cast<size_t>(place[1]) * static_cast<size_t>(sizes_.grid.width) +
           static_cast<size_t>(place[0]);
  }
  /// Whether all manifolds take one turn.
  bool IsWhole() const { return plan_.manifolds == sizes_.manifolds; }
  float InCells(float sigma) const { return sigma / static_cast<float>(sizes_.options.step); }

  Buffer Bytes(size_t count) {
    own_.push_back(run_.Allocate(count));
    return own_.back();
  }
  Buffer Floats(size_t count) { return Bytes(count * sizeof(float)); }
  Buffer Zeros(size_t count) {
    const Buffer buffer = Floats(count);
    run_.Run("Clear", count, {Int(count), buffer});
    return buffer;
  }
  template <typename Values>
  Buffer Upload(const Values& values) {
    own_.push_back(run_.Upload(values));
    return own_.back();
  }
  /// The manifolds, the weights of sites on those of a turn and the sums of all; and what splits clusters.
  struct Tree {
    Buffer eta, weights, total;
    Buffer sums, low, axes;
    Buffer members, masses, labels;
  };
  /// What is splatted and blurred, the links of cells to the left and above; the sums over manifolds, in
  /// whose place the result comes, and what points found.
  struct Blurred {
    Buffer psi, across, down;
    Buffer planes, found;
  };
  /// The points by cells, as kernel Splat has them.
  struct PointOrder {
    Buffer firsts, order;
  };

  void GrowTree();
  /// `count` manifolds from `first` on, of a level of `level` manifolds.
  void GrowClusters(int32_t level, int32_t first, int32_t count, bool splits);
  /// The axes that split `count` clusters of a level from cluster `cluster` on.
  void FindAxes(int32_t count, int32_t first, int32_t cluster);
  /// Weights that stay are kept from manifold `origin` on.
  void Weigh(int32_t count, int32_t first, bool stays, int32_t origin, bool splits);
  /// What sites weigh in splats.
  void WeighSites();
  PointOrder OrderPoints();
  void SplatBlurSlice();
  void Blur(int32_t count, int32_t first);

  const SiteFiltering& call_;
  KernelRun& run_;
  const ManifoldSizes& sizes_;
  const MemoryPlan plan_;
  std::vector<Buffer> own_;
  Tree tree_ = {};
  Blurred blurred_ = {};
};

void ManifoldRun::FindAxes(int32_t count, int32_t first, int32_t cluster) {
  const int32_t row_step = std::max(1, sizes_.grid.rows / kAxisRows);
  const auto rows = static_cast<size_t>((sizes_.grid.rows + row_step - 1) / row_step);
  const size_t entries = static_cast<size_t>(count) * (Features() * (Features() + 1) / 2 + 1);
  const Buffer row_sums = Bytes(rows * entries * sizeof(double));
  const Buffer covariance = Bytes(entries * sizeof(double));
  run_.Run("RowCovariance", rows * entries,
           {sizes_.grid, count, first, row_step, tree_.sums, tree_.eta, row_sums});
  run_.Run("Covariance", entries, {sizes_.grid, count, row_step, row_sums, covariance});
  run_.Run("Axis", static_cast<size_t>(count),
           {count, cluster, call_.params.pca_iterations, covariance, tree_.axes});
  for (const Buffer buffer : {row_sums, covariance}) run_.Release(buffer);
}

void ManifoldRun::Weigh(int32_t count, int32_t first, bool stays, int32_t origin, bool splits) {
  run_.Run("Weigh", sizes_.sites,
           {sizes_.grid, count, first, stays ? 1 : 0, origin, splits ? 1 : 0,
            Int(Features() - Points().own_features), Points().pixel_divisor, call_.places, call_.features,
            tree_.eta, tree_.axes, tree_.members, tree_.labels, tree_.total, tree_.weights, tree_.masses});
}

void ManifoldRun::GrowClusters(int32_t level, int32_t first, int32_t count, bool splits) {
  const auto images = static_cast<size_t>(count);
  const size_t planes = images * (Features() + 1);
  const float link = Exp(-kSqrt2 / InCells(call_.params.sigma_s));
  const int32_t cluster = first - (level - 1);
  const int32_t parent = level == 1 ? -1 : level / 2 - 1 + cluster / 2;
  run_.Run("ClusterSums", images * sizes_.cells,
           {sizes_.grid, count, cluster, call_.features, tree_.labels, tree_.masses, tree_.sums});
  run_.Run("EvenRows", planes * Rows(), {sizes_.grid, count, link, tree_.sums, tree_.low});
  run_.Run("EvenColumns", planes * Columns(), {sizes_.grid, count, link, tree_.low});
  run_.Run("Heights", images * sizes_.cells, {sizes_.grid, count, first, parent, tree_.low, tree_.eta});
  if (splits) FindAxes(count, first, cluster);
}

void ManifoldRun::GrowTree() {
  const size_t pixel_bytes = sizes_.pixels * sizeof(float);
  const size_t most_clusters = size_t{1} << (sizes_.levels - 1);
  const size_t sums = static_cast<size_t>(plan_.clusters) * sizes_.cells * (Features() + 1);
  tree_ = {.eta = Floats(static_cast<size_t>(sizes_.manifolds) * sizes_.cells * Features()),
           .weights = Floats(IsWhole() ? static_cast<size_t>(sizes_.manifolds) * sizes_.sites : 0),
           .total = Zeros(sizes_.sites),
           .sums = Floats(sums),
           .low = Floats(sums),
           .axes = Floats(most_clusters * Features()),
           .members = Floats(sizes_.pixels),
           .masses = Floats(sizes_.pixels),
           .labels = Zeros(sizes_.pixels)};
  for (const Buffer buffer : {tree_.members, tree_.masses}) run_.Copy(call_.masks, 0, buffer, 0, pixel_bytes);
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
  if (IsWhole()) run_.Release(call_.features);
}

void ManifoldRun::WeighSites() {
  if (!Points().signals.empty()) {
    std::vector<int32_t> replaced;
    for (size_t i = 0; i < Points().weights.size(); ++i) {
      if (Points().weights[i] > 0) replaced.push_back(Int(PixelAt(Points().pixels[i])));
    }
    std::sort(replaced.begin(), replaced.end());
    replaced.erase(std::unique(replaced.begin(), replaced.end()), replaced.end());
    const Buffer pixels = Upload(replaced);
    run_.Run("Replace", replaced.size(), {Int(replaced.size()), pixels, call_.masks});
    run_.Release(pixels);
    run_.Write(call_.masks, sizes_.pixels * sizeof(float), Points().weights.data(),
               Points().weights.size() * sizeof(float));
  }
  if (call_.params.keeps_mass) run_.Run("KeepMass", sizes_.sites, {sizes_.grid, tree_.total, call_.masks});
}

ManifoldRun::PointOrder ManifoldRun::OrderPoints() {
  std::vector<std::vector<int32_t>> by_cell(sizes_.cells);
  std::vector<size_t> by_row(Points().pixels.size());
  std::iota(by_row.begin(), by_row.end(), size_t{0});
  std::sort(by_row.begin(), by_row.end(), [&](size_t i, size_t j) {
    return std::pair(Points().pixels[i][1], i) < std::pair(Points().pixels[j][1], j);
  });
  for (const size_t i : by_row) {
    const auto [x, y] = Points().pixels[i];
    by_cell[static_cast<size_t>(y / sizes_.options.step) * Columns() +
            static_cast<size_t>(x / sizes_.options.step)]
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
  run_.Run("Links", images * sizes_.cells,
           {sizes_.grid, count, first, sigma, stretch, tree_.eta, blurred_.across, blurred_.down});
  run_.Run("GuidedRows", images * Rows() * Planes(), {sizes_.grid, count, blurred_.across, blurred_.psi});
  run_.Run("GuidedColumns", images * Columns() * Planes(), {sizes_.grid, count, blurred_.down, blurred_.psi});
}

void ManifoldRun::SplatBlurSlice() {
  const PointOrder points = OrderPoints();
  const auto most = static_cast<size_t>(plan_.manifolds);
  if (!IsWhole()) tree_.weights = Floats(most * sizes_.sites);
  const size_t planes = IsWhole() ? static_cast<size_t>(sizes_.options.channels) : Planes();
  blurred_ = {.psi = Floats(most * sizes_.cells * Planes()),
              .across = Floats(most * sizes_.cells),
              .down = Floats(most * sizes_.cells),
              .planes = Floats(sizes_.sites * planes),
              .found = Floats(Points().pixels.size())};
  for (int32_t first = 0; first < sizes_.manifolds; first += plan_.manifolds) {
    const int32_t count = std::min(plan_.manifolds, sizes_.manifolds - first);
    const size_t all_cells = static_cast<size_t>(count) * sizes_.cells;
    if (!IsWhole()) Weigh(count, first, /*stays=*/true, /*origin=*/first, /*splits=*/false);
    run_.Run("Splat", all_cells,
             {sizes_.grid, count, call_.reach, call_.places, points.firsts, points.order, call_.signals,
              call_.masks, tree_.weights, blurred_.psi});
    if (sizes_.options.fits) run_.Run("Moments", all_cells, {sizes_.grid, count, blurred_.psi});
    Blur(count, first);
    run_.Run("Slice", sizes_.sites,
             {sizes_.grid, count, first == 0 ? 1 : 0, first + count == sizes_.manifolds ? 1 : 0, call_.reach,
              call_.params.slope_ridge, call_.places, call_.signals, tree_.weights, blurred_.psi,
              blurred_.planes, blurred_.found});
  }
}

/// The planes of a call as planes of sites.
class CallPlanes {
 public:
  CallPlanes(const ManifoldCall& call, const ManifoldSizes& sizes, KernelRun* run)
      : call_(call), sizes_(sizes), run_(*run) {}

  const SlicePoints& Points() const {
    static const SlicePoints none;
    return call_.points != nullptr ? *call_.points : none;
  }

  SiteFiltering Put() {
    std::vector<int32_t> places;
    for (const auto& [x, y] : Points().pixels) places.insert(places.end(), {x, y});
    const Buffer of_points = run_.Upload(places);
    const Buffer features = Features(of_points);
    const size_t channels = call_.signals.size();
    const Buffer signals = run_.Floats(channels * sizes_.sites);
    for (size_t c = 0; c < channels; ++c) {
      run_.WritePlane(call_.signals[c], signals, c * sizes_.sites * sizeof(float));
      PutPoints(c, signals, [&](size_t i) {
        return Points().signals.empty() ? 0.0f : Points().signals[i * channels + c];
      });
    }
    const Buffer masks = run_.Floats(sizes_.sites);
    run_.Run("Clear", sizes_.sites, {Int(sizes_.sites), masks});
    run_.WritePlane(call_.mask, masks, 0);
    return {sizes_, call_.params, call_.reach, Points(), of_points, features, signals, masks};
  }

 private:
  /// Writes value(i) for each point i behind the pixels of plane k.
  template <typename Value>
  void PutPoints(size_t k, Buffer planes, const Value& value) {
    std::vector<float> values(Points().pixels.size());
    for (size_t i = 0; i < values.size(); ++i) values[i] = value(i);
    run_.Write(planes, (k * sizes_.sites + sizes_.pixels) * sizeof(float), values.data(),
               values.size() * sizeof(float));
  }

  void Project(Buffer features) {
    const PatchProjection& patches = call_.patches;
    if (patches.dimensions == 0) return;
    const Buffer color = run_.Floats(patches.color.size() * sizes_.pixels);
    for (size_t c = 0; c < patches.color.size(); ++c)
      run_.WritePlane(patches.color[c], color, c * sizes_.pixels * sizeof(float));
    filter::ProjectPatches(sizes_.grid, patches, patches.color.size(), color, features, &run_);
    run_.Release(color);
  }

  Buffer Features(Buffer places) {
    const size_t count = call_.FeatureCount();
    const Buffer features = run_.Floats(count * sizes_.sites);
    Project(features);
    const auto first = static_cast<size_t>(call_.patches.dimensions);
    for (size_t k = 0; k < call_.features.size(); ++k)
      run_.WritePlane(call_.features[k], features, (first + k) * sizes_.sites * sizeof(float));
    const size_t own = Points().own_features, shared = count - own;
    run_.Run("ShareFeatures", shared * Points().pixels.size(), {sizes_.grid, Int(shared), places, features});
    for (size_t k = 0; k < own; ++k)
      PutPoints(shared + k, features, [&](size_t i) { return Points().features[i * own + k]; });
    return features;
  }

  const ManifoldCall& call_;
  const ManifoldSizes& sizes_;
  KernelRun& run_;
};

absl::StatusOr<ManifoldResult> ResultOf(const ManifoldCall& call, const FilteredSites& sites,
                                        KernelRun* run) {
  const size_t points = call.points != nullptr ? call.points->pixels.size() : 0;
  absl::StatusOr<ManifoldResult> result =
      ReadSites({call.mask.width(), call.mask.height(), points, call.signals.size()}, sites.planes, 0, run);
  if (!result.ok()) return result;
  result->points.weights.resize(points);
  absl::Status status = run->Read(sites.found, 0, points * sizeof(float), result->points.weights.data());
  if (!status.ok()) return status;
  return result;
}

}  // namespace

void ProjectPatches(const Grid& grid, const PatchProjection& patches, size_t channels, Buffer color,
                    Buffer features, KernelRun* run) {
  const auto pixels = static_cast<size_t>(grid.width) * static_cast<size_t>(grid.height);
  const Buffer taps = run->Upload(patches.taps);
  run->Run("Project", static_cast<size_t>(patches.dimensions) * pixels,
           {grid, Int(channels), patches.dimensions, patches.radius, patches.scale, color, taps, features});
  run->Release(taps);
}

absl::Status RunFiltering(const SiteFiltering& filtering, const DeviceMemory& memory, KernelRun* run,
                          absl::FunctionRef<absl::Status(const FilteredSites&)> use) {
  ManifoldRun of_call(filtering, memory, run);
  const absl::StatusOr<FilteredSites> sites = of_call.Run();
  return sites.ok() ? use(*sites) : sites.status();
}

absl::StatusOr<ManifoldResult> ReadSites(const SiteCounts& counts, Buffer from, size_t first,
                                         KernelRun* run) {
  const auto width = static_cast<size_t>(counts.width);
  const size_t pixels = width * static_cast<size_t>(counts.height);
  ManifoldResult result{MakeUninitializedPlanes(counts.planes, counts.width, counts.height), {}};
  result.points.values.resize(counts.points * counts.planes);
  std::vector<float> values(pixels + counts.points);
  const size_t bytes = values.size() * sizeof(float);
  for (size_t c = 0; c < counts.planes; ++c) {
    if (absl::Status status = run->Read(from, (first + c) * bytes, bytes, values.data()); !status.ok())
      return status;
    for (int y = 0; y < counts.height; ++y)
      std::copy_n(values.data() + static_cast<size_t>(y) * width, width, result.filtered[c].Row(y));
    for (size_t i = 0; i < counts.points; ++i)
      result.points.values[i * counts.planes + c] = values[pixels + i];
  }
  return result;
}

KernelOptions KernelsOf(const ManifoldCall& call) {
  return {static_cast<int>(call.FeatureCount()), static_cast<int>(call.signals.size()),
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
  run->Use(KernelsOf(call));
  const ManifoldSizes sizes(call);
  absl::StatusOr<ManifoldResult> result = absl::InternalError("no result");
  absl::Status status =
      RunFiltering(CallPlanes(call, sizes, run).Put(), memory, run, [&](const FilteredSites& sites) {
        result = ResultOf(call, sites, run);
        return result.status();
      });
  if (!status.ok()) return status;
  return result;
}

}  // namespace lumifold::filter
