#include "filter/opencl/layer_run.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "filter/image/portable_math.h"
#include "filter/manifold/nlm_space.h"
#include "filter/opencl/choice_run.h"
#include "filter/opencl/energy_run.h"
#include "filter/opencl/layer_planes.h"
#include "filter/opencl/light_run.h"
#include "filter/opencl/manifold_run.h"

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

constexpr uint64_t kPicture = LayerSizes::kPicturePlanes;

PatchLattice LatticeOf(const LayerSizes& sizes, const GuidedHalves& halves) {
  return {sizes.grid.width, sizes.grid.height, 3, halves.patches.radius};
}

/// With so many coordinates of patches.
ManifoldSizes SizesOf(const LayerSizes& sizes, const GuidedHalves& halves, int dimensions) {
  const ManifoldParams& params = halves.manifolds;
  const size_t taps = static_cast<size_t>(dimensions) * LatticeOf(sizes, halves).dimensions;
  const KernelOptions kernels = {dimensions + Int(sizes.geometry), 3, params.is_first_order, CellOf(params)};
  return {kernels, params, sizes.grid.width, sizes.grid.height, sizes.points, taps};
}

/// The layer, its pictures, and what returns.
DeviceMemory ResidentNeed(const LayerCall& call, const LayerSizes& sizes) {
  const uint64_t picture = kPicture * sizes.sites;
  DeviceMemory need = More(LayerPlanes::Need(sizes), Together({picture, picture}));
  for (size_t i = 1; i < call.further.scales.size(); ++i) need = More(need, Together({picture}));
  if (!call.removed.has_value()) return need;
  const uint64_t energy = kEnergyPlanes * sizes.pixels;
  return More(need, Together({energy, energy, 3 * sizes.pixels}));
}

/// The axes of patches.
DeviceMemory BasisNeed(const LayerSizes& sizes, const GuidedHalves& halves) {
  const PatchLattice lattice = LatticeOf(sizes, halves);
  return Together({3 * sizes.pixels, 3 * sizes.pixels, lattice.rows.size(), lattice.columns.size(),
                   lattice.window.size(), lattice.Parts() * PatchProducts(lattice.dimensions).sums.size()});
}

std::optional<LightLayout> LayoutOf(const LayerCall& call) {
  if (!call.fit.has_value()) return std::nullopt;
  return std::optional<LightLayout>(std::in_place, call, *call.fit);
}

DeviceMemory ChoiceNeed(const LayerCall& call, const LayerSizes& sizes) {
  const DeviceMemory need = ChoiceRun::Need(sizes);
  const std::optional<LightLayout> layout = LayoutOf(call);
  return layout.has_value() ? More(need, layout->Need()) : need;
}

/// Both groups of filterings, of which the second one may be empty.
std::vector<const GuidedHalves*> GroupsOf(const LayerCall& call) {
  std::vector<const GuidedHalves*> groups = {&call.first};
  if (!call.further.scales.empty()) groups.push_back(&call.further);
  return groups;
}

/// One call; its work is in the order of the members.
class LayerRun {
 public:
  LayerRun(const LayerCall& call, const DeviceMemory& memory, KernelRun* run)
      : call_(call),
        run_(*run),
        sizes_(call),
        memory_(Less(memory, ResidentNeed(call, sizes_))),
        layer_(call, sizes_, run) {}

  absl::StatusOr<LayerResult> Run() {
    run_.Use(LayerProgram{});
    picture_ = run_.Floats(kPicture * sizes_.sites);
    for (size_t i = 0; i < std::max<size_t>(call_.further.scales.size(), 1); ++i)
      others_.push_back(run_.Floats(kPicture * sizes_.sites));
    absl::Status status = Filter(call_.first, layer_.noisy, std::nullopt, {&picture_, 1});
    if (status.ok() && call_.removed.has_value()) status = ReturnEnergy(*call_.removed);
    if (status.ok() && !call_.further.scales.empty())
      status = Filter(call_.further, picture_, picture_, others_);
    if (status.ok()) status = Choose();
    if (status.ok()) status = run_.Finish();
    return status.ok() ? Result() : status;
  }

 private:
  void CopyPicture(Buffer from, Buffer to) {
    run_.Copy(from, 0, to, 0, kPicture * sizes_.sites * sizeof(float));
  }

  /// The pixels of a half of a picture, with stabilised variance.
  Buffer Stabilised(Buffer picture, size_t h) {
    const size_t bytes = sizes_.pixels * sizeof(float);
    const Buffer color = run_.Floats(3 * sizes_.pixels);
    for (size_t c = 0; c < 3; ++c)
      run_.Copy(picture, (3 * h + c) * sizes_.sites * sizeof(float), color, c * bytes, bytes);
    const float inverse_knee = 1.0f / (call_.knee * call_.halves.level);
    run_.Run("Stabilise", 3 * sizes_.pixels,
             {Int(3 * sizes_.pixels), inverse_knee, Asinh(call_.halves.level * inverse_knee), color});
    return color;
  }

  /// The principal axes of a picture's patches, over the range.
  absl::StatusOr<PatchBasis> FitBasis(Buffer picture, const GuidedHalves& halves) {
    const Buffer mean = Stabilised(picture, 0), other = Stabilised(picture, 1);
    run_.Run("MeanOfHalves", 3 * sizes_.pixels, {sizes_.grid, 3, layer_.share_a, other, mean});
    const PatchLattice lattice = LatticeOf(sizes_, halves);
    PatchProducts products(lattice.dimensions);
    const size_t entries = products.sums.size(), count = lattice.Parts() * entries;
    const Buffer rows = run_.Upload(lattice.rows), columns = run_.Upload(lattice.columns);
    const Buffer window = run_.Upload(lattice.window), sums = run_.Floats(count);
    run_.Run("PatchProducts", count,
             {sizes_.grid, Int(lattice.dimensions + 1), lattice.radius, Int(PatchLattice::kLatticeRows),
              Int(lattice.rows.size()), Int(lattice.columns.size()), rows, columns, window, layer_.weight,
              mean, sums});
    absl::Status status = run_.Finish();
    std::vector<float> parts(count);
    if (status.ok()) status = run_.Read(sums, 0, count * sizeof(float), parts.data());
    if (!status.ok()) return status;
    for (const Buffer buffer : {mean, other, rows, columns, window, sums}) run_.Release(buffer);
    for (size_t i = 0; i < count; ++i) products.sums[i % entries] += static_cast<double>(parts[i]);
    PatchBasis basis = BasisOf(products, lattice, halves.patches);
    for (float& tap : basis.kernels) tap /= halves.sigma_q;
    return basis;
  }

  /// The coordinates of a picture's patches, and the geometry. The program becomes that of the filtering.
  Buffer Features(const ManifoldSizes& sizes, Buffer picture, size_t h, const PatchBasis& basis,
                  float scale) {
    const size_t all = static_cast<size_t>(sizes.options.features);
    const auto dimensions = static_cast<size_t>(basis.dimensions);
    const Buffer features = run_.Floats(all * sizes_.sites);
    if (dimensions > 0) {
      const Buffer color = Stabilised(picture, h);
      run_.Use(sizes.options);
      ProjectPatches(sizes.grid, {{}, basis.radius, basis.dimensions, basis.kernels, scale}, 3, color,
                     features, &run_);
      run_.Release(color);
      run_.Run("ShareFeatures", dimensions * sizes_.points,
               {sizes.grid, basis.dimensions, layer_.points.places, features});
    }
    run_.Use(sizes.options);
    run_.Copy(layer_.geometry, 0, features, dimensions * sizes_.sites * sizeof(float),
              sizes_.geometry * sizes_.sites * sizeof(float));
    return features;
  }

  /// A half of the noisy layer, or what a picture leaves of it.
  Buffer Signals(size_t h, std::optional<Buffer> base) {
    const Buffer signals = run_.Floats(3 * sizes_.sites);
    run_.Copy(layer_.noisy, 3 * h * sizes_.sites * sizeof(float), signals, 0,
              3 * sizes_.sites * sizeof(float));
    if (base.has_value()) run_.Run("SubtractHalf", 3 * sizes_.sites, {sizes_.grid, Int(h), *base, signals});
    return signals;
  }

  Buffer Masks(size_t h) {
    const Buffer masks = run_.Floats(sizes_.sites);
    const std::vector<float> none(sizes_.points);
    run_.Copy(layer_.masks[h], 0, masks, 0, sizes_.pixels * sizeof(float));
    run_.Write(masks, sizes_.pixels * sizeof(float), none.data(), none.size() * sizeof(float));
    return masks;
  }

  /// Filters both halves, guided by the other one of a picture, into `to`, one for each scale. With a base:
  /// what it leaves.
  absl::Status Filter(const GuidedHalves& halves, Buffer guide, std::optional<Buffer> base,
                      absl::Span<const Buffer> to) {
    const absl::StatusOr<PatchBasis> basis = FitBasis(guide, halves);
    if (!basis.ok()) return basis.status();
    const ManifoldSizes sizes = SizesOf(sizes_, halves, basis->dimensions);
    for (size_t h = 0; h < 2; ++h) {
      for (size_t i = 0; i < to.size(); ++i) {
        absl::Status status = FilterHalf(halves, sizes, guide, *basis, h, i, base, to[i]);
        if (!status.ok()) return status;
      }
    }
    return absl::OkStatus();
  }

  absl::Status FilterHalf(const GuidedHalves& halves, const ManifoldSizes& sizes, Buffer guide,
                          const PatchBasis& basis, size_t h, size_t scale, std::optional<Buffer> base,
                          Buffer to) {
    static const SlicePoints none;
    const SlicePoints& points = call_.points.of_halves[h] != nullptr ? *call_.points.of_halves[h] : none;
    const Buffer signals = Signals(h, base), masks = Masks(h);
    const Buffer features = Features(sizes, guide, 1 - h, basis, halves.scales[scale]);
    absl::Status status = RunFiltering(
        {sizes, halves.manifolds, call_.reach_px, points, layer_.points.places, features, signals, masks},
        memory_, &run_, [&](const FilteredSites& sites) {
          run_.Use(LayerProgram{});
          run_.Run("TakeFiltered", sizes_.sites,
                   {sizes_.grid, Int(h), base.has_value() ? 1 : 0, layer_.points.shares[h], sites.found,
                    signals, sites.planes, base.value_or(to), to});
          run_.Run("MeanOfPoints", layer_.points.runs,
                   {sizes_.grid, Int(h), Int(layer_.points.runs), layer_.points.firsts, layer_.points.places,
                    layer_.points.coverage[h], to});
          return run_.Finish();
        });
    run_.Use(LayerProgram{});
    return status;
  }

  absl::Status ReturnEnergy(const RemovedLight& removed) {
    removed_ = run_.Floats(kEnergyPlanes * sizes_.pixels);
    for (size_t i = 0; i < kEnergyPlanes; ++i)
      run_.WritePlane(removed.planes[i / 3][i % 3], removed_, i * sizes_.pixels * sizeof(float));
    if (!removed.returns) return absl::OkStatus();
    energy_ = run_.Floats(kEnergyPlanes * sizes_.pixels);
    return RunEnergy(call_, removed, layer_, memory_, picture_, removed_, *energy_, &run_);
  }

  void AddEnergy(Buffer picture) {
    if (energy_.has_value())
      run_.Run("AddEnergy", sizes_.sites, {sizes_.grid, layer_.points.places, *energy_, picture});
  }

  absl::Status Choose() {
    ChoiceRun choice(call_, layer_, &run_);
    choice.WeighErrors(picture_);
    for (size_t i = 0; i < call_.further.scales.size(); ++i)
      choice.Move(picture_, others_[i], others_[i], false);
    if (call_.fit.has_value()) {
      const LightLayout layout(call_, *call_.fit);
      const DeviceMemory left = Less(memory_, ChoiceRun::Need(sizes_));
      if (absl::Status status = RunLightFit(call_, layout, layer_, left, picture_, others_[0], &run_);
          !status.ok())
        return status;
      run_.Use(LayerProgram{});
      choice.WeighErrors(picture_);
      choice.Move(picture_, others_[0], others_[0], false);
    }
    AddEnergy(picture_);
    if (call_.may_stay_noisy) MoveTowardsNoisy(&choice);
    if (energy_.has_value()) {
      returned_ = run_.Floats(3 * sizes_.pixels);
      run_.Run("ShareEnergy", 3 * sizes_.pixels, {sizes_.grid, layer_.share_a, *energy_, returned_});
      AddEnergy(picture_);
    }
    return absl::OkStatus();
  }

  /// Towards the noisy layer without its fireflies, as far as the noisy layer as it was says.
  void MoveTowardsNoisy(ChoiceRun* choice) {
    const Buffer noisy = others_[0];
    CopyPicture(layer_.noisy, noisy);
    AddEnergy(noisy);
    if (call_.removed.has_value())
      run_.Run("AddToPixels", kEnergyPlanes * sizes_.pixels, {sizes_.grid, removed_, layer_.noisy});
    if (sizes_.points > 0) layer_.PutPoints(call_.points.uncut, layer_.noisy);
    choice->WeighErrors(picture_);
    choice->Move(picture_, layer_.noisy, noisy, true);
  }

  absl::StatusOr<LayerResult> Result() {
    LayerResult result;
    const SiteCounts counts = {sizes_.grid.width, sizes_.grid.height, sizes_.points, 3};
    for (size_t h = 0; h < 2; ++h) {
      absl::StatusOr<ManifoldResult> half = ReadSites(counts, picture_, 3 * h, &run_);
      if (!half.ok()) return half.status();
      result.halves[h] = *std::move(half);
    }
    if (!energy_.has_value()) return result;
    absl::StatusOr<ManifoldResult> returned =
        ReadSites({counts.width, counts.height, 0, 3}, returned_, 0, &run_);
    if (!returned.ok()) return returned.status();
    result.returned = std::move(returned->filtered);
    return result;
  }

  const LayerCall& call_;
  KernelRun& run_;
  const LayerSizes sizes_;
  const DeviceMemory memory_;  // beside what stays
  const LayerPlanes layer_;
  Buffer picture_ = {};
  std::vector<Buffer> others_;
  Buffer removed_ = {}, returned_ = {};
  std::optional<Buffer> energy_;
};

/// The most that a phase of the call takes, beside what stays; of a filtering, and the return of energy.
DeviceMemory WorkNeed(const LayerCall& call, const LayerSizes& sizes,
                      absl::FunctionRef<DeviceMemory(const ManifoldSizes&)> of_filtering,
                      absl::FunctionRef<DeviceMemory(const RemovedLight&)> of_energy) {
  DeviceMemory need = ChoiceNeed(call, sizes);
  if (call.removed.has_value() && call.removed->returns) Extend(of_energy(*call.removed), &need);
  for (const GuidedHalves* halves : GroupsOf(call)) {
    Extend(BasisNeed(sizes, *halves), &need);
    Extend(of_filtering(SizesOf(sizes, *halves, halves->patches.most_dimensions)), &need);
  }
  return need;
}

}  // namespace

DeviceMemory LeastMemory(const LayerCall& call) {
  const LayerSizes sizes(call);
  const auto energy = [&](const RemovedLight& removed) { return EnergyNeed(call, removed, sizes); };
  const auto least = [](const ManifoldSizes& of) { return NeedOf(LeastPlan(of), of); };
  return More(ResidentNeed(call, sizes), WorkNeed(call, sizes, least, energy));
}

DeviceMemory TakenMemory(const LayerCall& call, const DeviceMemory& memory) {
  const LayerSizes sizes(call);
  const DeviceMemory left = Less(memory, ResidentNeed(call, sizes));
  const auto energy = [&](const RemovedLight& removed) { return TakenByEnergy(call, removed, sizes, left); };
  const auto taken = [&](const ManifoldSizes& of) { return NeedOf(PlanFor(left, of), of); };
  return More(ResidentNeed(call, sizes), WorkNeed(call, sizes, taken, energy));
}

absl::StatusOr<LayerResult> RunLayerCall(const LayerCall& call, const DeviceMemory& memory, KernelRun* run) {
  return LayerRun(call, memory, run).Run();
}

}  // namespace lumifold::filter
