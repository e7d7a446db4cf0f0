#include "filter/opencl/refine_run.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "filter/manifold/fit_layout.h"
#include "filter/opencl/device_planes.h"
#include "filter/opencl/fit_run.h"
#include "filter/opencl/manifold_run.h"

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

constexpr uint64_t kPicturePlanes = 6;  // of sites: two halves
constexpr uint64_t kTerms = 6;          // as choice.cl has them

/// Sizes of one call.
struct RefineSizes {
  explicit RefineSizes(const RefineCall& call) {
    const ManifoldCall& first = call.filterings.front();
    const auto cells = [](int side) { return (side + kChoiceCell - 1) / kChoiceCell; };
    const size_t count = first.points != nullptr ? first.points->pixels.size() : 0;
    grid = {first.mask.width(), first.mask.height(), cells(first.mask.width()), cells(first.mask.height()),
            static_cast<int32_t>(count)};
    pixels = static_cast<uint64_t>(grid.width) * static_cast<uint64_t>(grid.height);
    points = count;
    sites = pixels + points;
    cells_in_all = static_cast<uint64_t>(grid.columns) * static_cast<uint64_t>(grid.rows);
    kinds = points > 0 ? kMostKinds : call.mixed.IsEmpty() ? 1 : kMixedKind + 1;
    candidates = call.filterings.size() / 2;
  }

  Grid grid = {};
  uint64_t pixels = 0, points = 0, sites = 0, cells_in_all = 0;
  int32_t kinds = 1;
  uint64_t candidates = 0;
};

/// The samples of the fit of light, and where they are.
struct LightLayout {
  LightLayout(const RefineCall& call, const LightFit& light_fit) : fit(light_fit) {
    const ManifoldCall& first = call.filterings.front();
    const auto width = static_cast<size_t>(first.mask.width());
    const size_t pixels = width * static_cast<size_t>(first.mask.height());
    std::vector<std::vector<int32_t>> points(first.points != nullptr ? pixels : 0);
    const auto index_of = [&](int x, int y) {
      return static_cast<size_t>(y) * width + static_cast<size_t>(x);
    };
    for (size_t i = 0; first.points != nullptr && i < first.points->pixels.size(); ++i) {
      const auto& [x, y] = first.points->pixels[i];
      points[index_of(x, y)].push_back(static_cast<int32_t>(pixels + i));
    }
    const auto sites_at = [&](int x, int y) {
      const size_t pixel = index_of(x, y);
      return points.empty() || points[pixel].empty() ? std::vector{static_cast<int32_t>(pixel)}
                                                     : points[pixel];
    };
    FitLayout layout = MakeFitLayout(call.mixed, WindowRadius(fit.params),
                                     [&](int x, int y) { return sites_at(x, y).size(); });
    firsts = std::move(layout.firsts);
    targets = std::move(layout.targets);
    for (size_t pixel = 0; pixel < pixels; ++pixel) {
      if (firsts[pixel] == firsts[pixel + 1]) continue;
      const bool is_on_grid = pixel % width % kFitStep == 0 && pixel / width % kFitStep == 0;
      for (const int32_t site : sites_at(static_cast<int>(pixel % width), static_cast<int>(pixel / width))) {
        sites.push_back(site);
        on_grid.push_back(is_on_grid);
      }
    }
    for (const int32_t target : targets) most_centres += on_grid[static_cast<size_t>(target)] ? 1 : 0;
  }

  LightFit fit;
  std::vector<int32_t> firsts, targets;
  std::vector<int32_t> sites;  // of each sample
  std::vector<bool> on_grid;   // whether it may be the centre of a model
  uint64_t most_centres = 0;
};

FitOnDevice FitOf(const RefineCall& call, const LightLayout& layout) {
  const ConstFloatView& mask = call.filterings.front().mask;
  return {
      .shape = kLightShape,
      .window = {mask.width(), mask.height(), WindowRadius(layout.fit.params), FalloffOf(layout.fit.params)},
      .slope = layout.fit.params.slope,
      .firsts = layout.firsts,
      .targets = layout.targets,
      .centres = {}};
}

DeviceMemory Less(DeviceMemory memory, const DeviceMemory& taken) {
  memory.whole -= std::min(memory.whole, taken.whole);
  return memory;
}
DeviceMemory More(DeviceMemory memory, const DeviceMemory& other) {
  return {memory.whole + other.whole, std::max(memory.largest, other.largest)};
}

/// The pictures that filterings leave behind, and what tells of points.
DeviceMemory KeptNeed(const RefineSizes& sizes) {
  DeviceMemory need = Together({kPicturePlanes * sizes.sites, sizes.points, sizes.points, sizes.points + 1,
                                2 * sizes.points, sizes.points, sizes.points});
  need.whole += sizes.candidates * kPicturePlanes * sizes.sites * sizeof(float);
  return need;
}

/// What the choice needs besides.
DeviceMemory ChoiceNeed(const RefineSizes& sizes) {
  const uint64_t plane = sizes.pixels, cells = static_cast<uint64_t>(sizes.kinds) * sizes.cells_in_all;
  // Samples, expected, weight, masks, mixed, light, weights of errors, kinds, shares twice, and terms.
  const DeviceMemory planes =
      Together({plane, plane, plane, plane, plane, plane, plane, plane, plane, plane, plane, 3 * plane});
  return More(planes, Together({kPicturePlanes * sizes.sites, kTerms * cells, kTerms * cells, cells,
                                sizes.points, sizes.points}));
}

/// What the fit needs besides.
DeviceMemory FitNeed(const RefineCall& call, const RefineSizes& sizes, const LightLayout& layout) {
  const uint64_t samples = layout.sites.size();
  return More(Together({call.filterings.front().features.size() * sizes.sites, samples, samples}),
              LeastMemory(FitOf(call, layout), layout.most_centres));
}

/// What is there after the filterings, beside what they leave.
DeviceMemory AfterNeed(const RefineCall& call, const RefineSizes& sizes,
                       const std::optional<LightLayout>& layout) {
  const DeviceMemory choice = ChoiceNeed(sizes);
  return layout.has_value() ? More(choice, FitNeed(call, sizes, *layout)) : choice;
}

std::optional<LightLayout> LayoutOf(const RefineCall& call) {
  if (!call.fit.has_value()) return std::nullopt;
  return LightLayout(call, *call.fit);
}

CallsPlan PlanOf(const RefineCall& call, const DeviceMemory& memory) {
  const RefineSizes sizes(call);
  return PlanOf(call.filterings, Less(memory, KeptNeed(sizes)), AfterNeed(call, sizes, LayoutOf(call)));
}

/// One call; its work is in the order of the members.
class RefineRun {
 public:
  RefineRun(const RefineCall& call, const DeviceMemory& memory, KernelRun* run)
      : call_(call),
        run_(*run),
        sizes_(call),
        plan_(PlanOf(call, memory)),
        memory_(memory),
        from_(call.filterings, plan_.planes_stay, run) {}

  absl::StatusOr<RefinedHalves> Run() {
    if (absl::Status status = Filter(); !status.ok()) return status;
    run_.Use(ChoiceProgram{});
    UploadNoisy();
    WeighErrors();
    for (const Buffer candidate : candidates_) Compare(candidate);
    if (call_.fit.has_value()) {
      if (absl::Status status = Fit(*call_.fit, candidates_.front()); !status.ok()) return status;
      run_.Use(ChoiceProgram{});
      WeighErrors();
      Compare(candidates_.front());
    }
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    RefinedHalves halves;
    for (size_t h = 0; h < 2; ++h) {
      absl::StatusOr<ManifoldResult> half =
          ReadSites({sizes_.grid.width, sizes_.grid.height, sizes_.points, 3}, picture_, 3 * h, &run_);
      if (!half.ok()) return half.status();
      halves[h] = *std::move(half);
    }
    return halves;
  }

 private:
  /// Points in runs, as choice.cl has them: what each half covers and has of samples of them, and their
  /// weights and samples in comparisons.
  struct Points {
    uint64_t runs = 0;
    Buffer firsts = {}, places = {};
    std::array<Buffer, 2> coverage = {}, shares = {};
    Buffer offsets = {}, weights = {}, samples = {};
  };
  /// What comparisons have in common.
  struct Layer {
    Buffer noisy = {}, samples = {}, expected = {}, weight = {}, mixed = {}, light = {};
    std::array<Buffer, 2> masks = {};
  };
  /// Weights of errors, kinds, terms, and shares: of windows, smoothed, of cells.
  struct Comparison {
    Buffer errors = {}, kind = {}, terms = {}, rough = {}, smooth = {};
    Buffer cells = {}, row_sums = {}, of_cells = {};
  };

  static int32_t Int(uint64_t count) { return static_cast<int32_t>(count); }
  /// A plane of pixels; zeros if it is empty.
  Buffer UploadPlane(ConstFloatView plane) {
    const Buffer buffer = run_.Floats(sizes_.pixels);
    if (plane.IsEmpty())
      run_.Write(buffer, 0, std::vector<float>(sizes_.pixels).data(), sizes_.pixels * sizeof(float));
    else
      from_.Put(plane, buffer, 0);
    return buffer;
  }
  /// Planes of pixels and values of points.
  void PutPicture(const std::array<PlaneViews, 2>& halves,
                  const std::array<absl::Span<const float>, 2>& points, Buffer to) {
    std::vector<float> channel(sizes_.points);
    for (size_t h = 0; h < 2; ++h) {
      for (size_t c = 0; c < 3; ++c) {
        const size_t at = (3 * h + c) * sizes_.sites * sizeof(float);
        from_.Put(halves[h][c], to, at);
        for (size_t i = 0; i < channel.size(); ++i) channel[i] = points[h][3 * i + c];
        run_.Write(to, at + sizes_.pixels * sizeof(float), channel.data(), channel.size() * sizeof(float));
      }
    }
  }
  const ManifoldCall& FirstOf(size_t h) const { return call_.filterings[h * sizes_.candidates]; }

  /// Where the points of each pixel begin.
  std::vector<int32_t> RunsOfPoints() const {
    std::vector<int32_t> firsts;
    for (size_t i = 0; i < sizes_.points; ++i) {
      const auto& pixels = FirstOf(0).points->pixels;
      if (i == 0 || pixels[i] != pixels[i - 1]) firsts.push_back(Int(i));
    }
    firsts.push_back(Int(sizes_.points));
    return firsts;
  }

  void UploadPoints() {
    const std::vector<int32_t> firsts = RunsOfPoints();
    points_.runs = firsts.size() - 1;
    points_.firsts = run_.Upload(firsts);
    std::vector<int32_t> places;
    places.reserve(2 * sizes_.points);
    for (size_t i = 0; i < sizes_.points; ++i) {
      const auto& place = FirstOf(0).points->pixels[i];
      places.insert(places.end(), place.begin(), place.end());
    }
    points_.places = run_.Upload(places);
    for (size_t h = 0; h < 2; ++h) {
      points_.coverage[h] = run_.Upload(call_.coverage[h]);
      points_.shares[h] = sizes_.points > 0 ? run_.Upload(FirstOf(h).points->weights) : run_.Floats(0);
    }
  }

  /// The filterings, as candidates.
  absl::Status Filter() {
    UploadPoints();
    picture_ = run_.Floats(kPicturePlanes * sizes_.sites);
    PutPicture({FirstOf(0).bases, FirstOf(1).bases}, call_.base, picture_);
    for (uint64_t i = 0; i < sizes_.candidates; ++i)
      candidates_.push_back(run_.Floats(kPicturePlanes * sizes_.sites));
    return RunEach(call_.filterings, plan_.of_calls, &from_, &run_,
                   [&](size_t i, const FilteredSites& sites) {
                     const size_t h = i / sizes_.candidates;
                     const Buffer to = candidates_[i % sizes_.candidates];
                     run_.Use(ChoiceProgram{});
                     run_.Run("TakeFiltered", sizes_.sites,
                              {sizes_.grid, Int(h), points_.shares[h], sites.found, sites.signals,
                               sites.planes, picture_, to});
                     run_.Run("MeanOfPoints", points_.runs,
                              {sizes_.grid, Int(h), Int(points_.runs), points_.firsts, points_.places,
                               points_.coverage[h], to});
                     return run_.Finish();
                   });
  }

  /// Brings what comparisons have in common.
  void UploadNoisy() {
    layer_.noisy = run_.Floats(kPicturePlanes * sizes_.sites);
    PutPicture({FirstOf(0).signals, FirstOf(1).signals}, call_.noisy, layer_.noisy);
    layer_.samples = UploadPlane(call_.samples);
    layer_.expected = UploadPlane(call_.expected);
    layer_.weight = UploadPlane(call_.weight);
    layer_.masks = {UploadPlane(FirstOf(0).mask), UploadPlane(FirstOf(1).mask)};
    layer_.mixed = UploadPlane(call_.mixed);
    layer_.light = UploadPlane(call_.light);
    points_.offsets = run_.Upload(call_.offsets);
    points_.weights = run_.Upload(call_.point_weights);
    points_.samples = run_.Upload(call_.point_samples);
    for (Buffer* const buffer : {&shares_.errors, &shares_.kind, &shares_.rough, &shares_.smooth})
      *buffer = run_.Floats(sizes_.pixels);
    shares_.terms = run_.Floats(3 * sizes_.pixels);
    const uint64_t cells = static_cast<uint64_t>(sizes_.kinds) * sizes_.cells_in_all;
    shares_.cells = run_.Floats(kTerms * cells);
    shares_.row_sums = run_.Floats(kTerms * cells);
    shares_.of_cells = run_.Floats(cells);
  }

  /// For comparisons with the picture as it is.
  void WeighErrors() {
    if (call_.light.IsEmpty())
      run_.Run("LightOf", sizes_.pixels, {sizes_.grid, 1.0f / (6.0f * call_.level), picture_, layer_.light});
    run_.Run("WeighErrors", sizes_.pixels,
             {sizes_.grid, call_.choice.dim, layer_.masks[0], layer_.masks[1], layer_.mixed, layer_.light,
              shares_.errors, shares_.kind});
    run_.Run("WeighErrorsOfPoints", points_.runs,
             {sizes_.grid, call_.choice.dim, Int(points_.runs), points_.firsts, points_.places, layer_.light,
              shares_.errors, shares_.kind});
  }

  /// Moves the picture towards a candidate.
  void Compare(Buffer candidate) {
    const Grid& grid = sizes_.grid;
    run_.Run("TermsOfPixels", sizes_.pixels,
             {grid, picture_, candidate, layer_.noisy, layer_.samples, layer_.expected, shares_.errors,
              shares_.kind, shares_.terms});
    run_.Run("TermsOfPoints", points_.runs,
             {grid, Int(points_.runs), points_.firsts, points_.places, picture_, candidate, layer_.noisy,
              points_.weights, points_.samples, shares_.errors, shares_.terms});
    CompareCells();
    run_.Run("ShareOfCells", sizes_.pixels, {grid, shares_.kind, shares_.of_cells, shares_.rough});
    run_.Run("RefinePixels", sizes_.pixels,
             {grid, call_.choice.narrow_radius, call_.choice.significance, shares_.kind, shares_.terms,
              shares_.rough});
    run_.Run("SmoothShare", sizes_.pixels,
             {grid, call_.choice.blend_radius, layer_.weight, shares_.kind, shares_.rough, shares_.smooth});
    run_.Run("MoveTowards", sizes_.sites, {grid, points_.places, shares_.smooth, candidate, picture_});
  }

  void CompareCells() {
    const Grid& grid = sizes_.grid;
    const uint64_t cells = static_cast<uint64_t>(sizes_.kinds) * sizes_.cells_in_all;
    run_.Write(shares_.of_cells, 0, std::vector<float>(cells).data(), cells * sizeof(float));
    run_.Run("TermsOfCells", sizes_.cells_in_all,
             {grid, sizes_.kinds, shares_.kind, shares_.terms, shares_.cells});
    for (const int pixels : {call_.choice.widest_radius, call_.choice.wide_radius}) {
      // As BoxMeans: a window over the whole picture reaches no further.
      const int32_t radius = std::min(pixels / kChoiceCell, std::max(grid.columns, grid.rows));
      run_.Run("SumRowsOfCells", kTerms * cells,
               {grid, Int(kTerms) * sizes_.kinds, radius, shares_.cells, shares_.row_sums});
      run_.Run("RefineCells", cells,
               {grid, sizes_.kinds, radius, call_.choice.significance, shares_.row_sums, shares_.of_cells});
    }
  }

  /// The features of all sites.
  Buffer UploadGeometry() {
    const ManifoldCall& first = FirstOf(0);
    const size_t count = first.features.size();
    const Buffer geometry = run_.Floats(count * sizes_.sites);
    static const SlicePoints none;
    const SlicePoints& points = first.points != nullptr ? *first.points : none;
    const size_t own = points.own_features;
    std::vector<float> of_points(sizes_.points);
    for (size_t k = 0; k < count; ++k) {
      const size_t at = k * sizes_.sites * sizeof(float);
      from_.Put(first.features[k], geometry, at);
      for (size_t i = 0; i < of_points.size(); ++i) {
        const auto& [x, y] = points.pixels[i];
        of_points[i] =
            k + own < count ? first.features[k].At(x, y) : points.features[i * own + (k + own - count)];
      }
      run_.Write(geometry, at + sizes_.pixels * sizeof(float), of_points.data(),
                 of_points.size() * sizeof(float));
    }
    return geometry;
  }

  /// The samples of the fit, of which those with weight on the grid are centres. Sets their weights.
  absl::Status MakeSamples(const LightLayout& layout, Buffer sites, Buffer weights, FitOnDevice* fit) {
    const RegressionParams& params = layout.fit.params;
    const Buffer geometry = UploadGeometry();
    fit->samples = run_.Floats(layout.sites.size() * static_cast<size_t>(kLightShape.Sample()));
    run_.Use(kLightShape);
    run_.Run("LightSamples", layout.sites.size(),
             {sizes_.grid, Int(layout.sites.size()), Int(FirstOf(0).features.size()), 1.0f / params.sigma_px,
              1.0f / params.sigma_light, 1.0f / layout.fit.knee, 1.0f / call_.level, sites, points_.places,
              points_.offsets, layer_.masks[0], layer_.masks[1], points_.shares[0], points_.shares[1],
              layer_.noisy, picture_, geometry, fit->samples, weights});
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    std::vector<float> of_samples(layout.sites.size());
    absl::Status status = run_.Read(weights, 0, of_samples.size() * sizeof(float), of_samples.data());
    for (const int32_t target : layout.targets) {
      const auto sample = static_cast<size_t>(target);
      if (layout.on_grid[sample] && of_samples[sample] > 0) fit->centres.push_back(target);
    }
    return status;
  }

  /// Makes `fitted` what the fit of the picture says.
  absl::Status Fit(const LightFit& light_fit, Buffer fitted) {
    run_.Copy(picture_, fitted, 0, kPicturePlanes * sizes_.sites * sizeof(float));
    const LightLayout layout(call_, light_fit);
    if (layout.targets.empty()) return absl::OkStatus();
    const Buffer sites = run_.Upload(layout.sites), weights = run_.Floats(layout.sites.size());
    FitOnDevice fit = FitOf(call_, layout);
    if (absl::Status status = MakeSamples(layout, sites, weights, &fit); !status.ok()) return status;
    const absl::StatusOr<FittedOnDevice> found = RunDeviceFit(fit, LeftToFit(layout), &run_);
    if (!found.ok()) return found.status();
    run_.Run("TakeFit", layout.targets.size(),
             {sizes_.grid, Int(layout.targets.size()), call_.level, found->targets, sites, weights,
              found->values, found->totals, fitted});
    return absl::OkStatus();
  }

  /// The memory of the fit and its samples.
  DeviceMemory LeftToFit(const LightLayout& layout) const {
    const DeviceMemory least = LeastMemory(FitOf(call_, layout), layout.most_centres);
    const DeviceMemory other = Less(FitNeed(call_, sizes_, layout), least);
    const uint64_t shared =
        plan_.planes_stay ? SharedPlanes(call_.filterings) * sizes_.pixels * sizeof(float) : 0;
    return Less(Less(memory_, {shared, 0}), More(More(KeptNeed(sizes_), ChoiceNeed(sizes_)), other));
  }

  const RefineCall& call_;
  KernelRun& run_;
  const RefineSizes sizes_;
  const CallsPlan plan_;
  const DeviceMemory memory_;
  DevicePlanes from_;
  Points points_;
  Buffer picture_ = {};
  std::vector<Buffer> candidates_;
  Layer layer_;
  Comparison shares_;
};

}  // namespace

DeviceMemory LeastMemory(const RefineCall& call) {
  const RefineSizes sizes(call);
  const DeviceMemory least = LeastMemory(call.filterings), after = AfterNeed(call, sizes, LayoutOf(call));
  return More({std::max(least.whole, after.whole), std::max(least.largest, after.largest)}, KeptNeed(sizes));
}

DeviceMemory TakenMemory(const RefineCall& call, const DeviceMemory& memory) {
  return More(PlanOf(call, memory).taken, KeptNeed(RefineSizes(call)));
}

absl::StatusOr<RefinedHalves> RunRefinement(const RefineCall& call, const DeviceMemory& memory,
                                            KernelRun* run) {
  return RefineRun(call, memory, run).Run();
}

}  // namespace lumifold::filter
