#include "filter/opencl/energy_run.h"

#include <cstddef>
#include <optional>
#include <vector>

#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "filter/manifold/returned_energy.h"
#include "filter/opencl/manifold_run.h"

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

constexpr uint64_t kSignals = 8;      // as energy.cl has them
constexpr uint64_t kLightPlanes = 5;  // those of LightAndRemoved

ManifoldParams ParamsOf(const LayerCall& call, const RemovedLight& removed) {
  return {.sigma_s = call.reach_px, .height = removed.spread_height};
}

ManifoldSizes SizesOf(const ManifoldParams& params, const LayerSizes& sizes) {
  return {{Int(sizes.geometry + 3), Int(kSignals), false, CellOf(params)},
          params,
          sizes.grid.width,
          sizes.grid.height,
          0,
          0};
}

/// What is there beside the filtering.
DeviceMemory OwnNeed(const LayerSizes& sizes) {
  const auto rows = static_cast<uint64_t>(sizes.grid.height);
  return Together({kLightPlanes * sizes.pixels, /*doubles*/ 2 * kEnergyPlanes * rows,
                   2 * kEnergyPlanes * rows, 2 * kLightPlanes * rows});
}

/// One return; its work is in the order of the members.
class EnergyRun {
 public:
  EnergyRun(const LayerCall& call, const RemovedLight& light, const LayerPlanes& layer, Buffer removed,
            Buffer energy, KernelRun* run)
      : call_(call),
        params_(light),
        layer_(layer),
        pixels_(layer.sizes.pixels),
        removed_(removed),
        energy_(energy),
        run_(*run),
        light_(run->Floats(kLightPlanes * pixels_)) {}

  absl::Status Run(Buffer picture, const DeviceMemory& memory) {
    run_.Use(LayerProgram{});
    run_.Run("LightAndRemoved", pixels_, {layer_.sizes.grid, layer_.share_a, picture, removed_, light_});
    if (absl::Status status = ReturnNearby(memory); !status.ok()) return status;
    if (absl::Status status = ReturnRest(); !status.ok()) return status;
    for (const Buffer buffer : {light_, of_removed_, of_energy_, of_light_}) run_.Release(buffer);
    return absl::OkStatus();
  }

 private:
  Buffer Features() {
    const Grid& grid = layer_.sizes.grid;
    const size_t bytes = pixels_ * sizeof(float), geometry = layer_.sizes.geometry;
    const Buffer features = run_.Floats((geometry + 3) * pixels_);
    for (size_t k = 0; k < geometry; ++k)
      run_.Copy(layer_.geometry, k * layer_.sizes.sites * sizeof(float), features, k * bytes, bytes);
    const float inverse_knee = 1.0f / (call_.knee * call_.halves.level);
    run_.Run("EnergyFeatures", 3 * pixels_,
             {grid, Int(geometry), inverse_knee, Asinh(call_.halves.level * inverse_knee),
              params_.spread_light, layer_.weight, light_, features});
    return features;
  }

  absl::Status ReturnNearby(const DeviceMemory& memory) {
    const Grid& grid = layer_.sizes.grid;
    const ManifoldParams params = ParamsOf(call_, params_);
    const ManifoldSizes sizes = SizesOf(params, layer_.sizes);
    const SlicePoints none;
    const Buffer features = Features(), signals = run_.Floats(kSignals * pixels_);
    run_.Run("EnergySignals", pixels_, {grid, removed_, signals});
    const Buffer masks = run_.Floats(pixels_);
    run_.Copy(layer_.weight, 0, masks, 0, pixels_ * sizeof(float));
    run_.Use(sizes.options);
    absl::Status status =
        RunFiltering({sizes, params, call_.reach_px, none, layer_.points.places, features, signals, masks},
                     memory, &run_, [&](const FilteredSites& sites) {
                       run_.Use(LayerProgram{});
                       run_.Run("SharedEnergy", pixels_, {grid, layer_.share_a, sites.planes, energy_});
                       return run_.Finish();
                     });
    run_.Use(LayerProgram{});
    return status;
  }

  Buffer RowTotals(Buffer planes, uint64_t count) {
    const uint64_t items = count * static_cast<uint64_t>(layer_.sizes.grid.height);
    const Buffer totals = run_.Allocate(items * sizeof(double));
    run_.Run("RowTotals", items, {layer_.sizes.grid, Int(count), layer_.weight, planes, totals});
    return totals;
  }

  /// The sum over each plane, in the order of SumRows.
  absl::Status ReadTotals(Buffer rows, uint64_t count, std::vector<double>* totals) {
    const int height = layer_.sizes.grid.height;
    std::vector<double> all(count * static_cast<uint64_t>(height));
    absl::Status status = run_.Read(rows, 0, all.size() * sizeof(double), all.data());
    for (size_t i = 0; i < count; ++i)
      totals->push_back(SumRows(nullptr, height, [&](int y) {
        return all[i * static_cast<size_t>(height) + static_cast<size_t>(y)];
      }));
    return status;
  }

  absl::Status ReturnRest() {
    of_removed_ = RowTotals(removed_, kEnergyPlanes);
    of_energy_ = RowTotals(energy_, kEnergyPlanes);
    of_light_ = RowTotals(light_, kLightPlanes);
    absl::Status status = run_.Finish();
    std::vector<double> removed, returned, light;
    if (status.ok()) status = ReadTotals(of_removed_, kEnergyPlanes, &removed);
    if (status.ok()) status = ReadTotals(of_energy_, kEnergyPlanes, &returned);
    if (status.ok()) status = ReadTotals(of_light_, kLightPlanes, &light);
    if (!status.ok()) return status;
    const float part = SharedPartOfAll(light[3], light[4]);
    for (size_t i = 0; i < kEnergyPlanes; ++i) {
      const size_t c = i % 3;
      if (const std::optional<float> gain = GainOfRest(part, removed[i], returned[i], light[c]))
        run_.Run("AddRest", pixels_, {layer_.sizes.grid, Int(i), Int(c), *gain, light_, energy_});
    }
    return absl::OkStatus();
  }

  const LayerCall& call_;
  const RemovedLight& params_;
  const LayerPlanes& layer_;
  const uint64_t pixels_;
  const Buffer removed_, energy_;
  KernelRun& run_;
  const Buffer light_;
  Buffer of_removed_ = {}, of_energy_ = {}, of_light_ = {};  // totals of rows
};

}  // namespace

DeviceMemory EnergyNeed(const LayerCall& call, const RemovedLight& removed, const LayerSizes& sizes) {
  const ManifoldSizes of_filtering = SizesOf(ParamsOf(call, removed), sizes);
  return More(OwnNeed(sizes), NeedOf(LeastPlan(of_filtering), of_filtering));
}

DeviceMemory TakenByEnergy(const LayerCall& call, const RemovedLight& removed, const LayerSizes& sizes,
                           const DeviceMemory& memory) {
  const ManifoldSizes of_filtering = SizesOf(ParamsOf(call, removed), sizes);
  return More(OwnNeed(sizes), NeedOf(PlanFor(Less(memory, OwnNeed(sizes)), of_filtering), of_filtering));
}

absl::Status RunEnergy(const LayerCall& call, const RemovedLight& light, const LayerPlanes& layer,
                       const DeviceMemory& memory, Buffer picture, Buffer removed, Buffer energy,
                       KernelRun* run) {
  return EnergyRun(call, light, layer, removed, energy, run).Run(picture, Less(memory, OwnNeed(layer.sizes)));
}

}  // namespace lumifold::filter
