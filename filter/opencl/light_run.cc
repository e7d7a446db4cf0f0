#include "filter/opencl/light_run.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "filter/manifold/fit_layout.h"

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

/// The points of a pixel: `count` from `first` on.
struct PointsOfPixel {
  int32_t first = 0, count = 0;
};

/// Those of each pixel; empty if there are none.
std::vector<PointsOfPixel> PointsByPixel(const LayerCall& call) {
  const auto width = static_cast<size_t>(call.halves.weight.width());
  const size_t pixels = width * static_cast<size_t>(call.halves.weight.height());
  std::vector<PointsOfPixel> points(call.points.Count() > 0 ? pixels : 0);
  for (size_t i = 0; i < call.points.Count(); ++i) {
    const auto& [x, y] = call.points.of_halves[0]->pixels[i];
    PointsOfPixel& at = points[static_cast<size_t>(y) * width + static_cast<size_t>(x)];
    at = {at.count == 0 ? Int(i) : at.first, at.count + 1};
  }
  return points;
}

/// The samples, of which those with weight on the grid are centres. Sets their weights.
absl::Status MakeSamples(const LayerCall& call, const LightLayout& layout, const LayerPlanes& layer,
                         Buffer picture, Buffer sites, Buffer weights, FitOnDevice* fit, KernelRun* run) {
  const size_t count = layout.sites.size();
  fit->samples = run->Floats(count * static_cast<size_t>(kLightShape.Sample()));
  run->Use(kLightShape);
  run->Run("LightSamples", count,
           {layer.sizes.grid, Int(count), Int(layer.sizes.geometry), 1.0f / layout.params.sigma_px,
            1.0f / layout.params.sigma_light, 1.0f / call.knee, 1.0f / call.halves.level, sites,
            layer.points.places, layer.points.offsets, layer.masks[0], layer.masks[1], layer.points.shares[0],
            layer.points.shares[1], layer.noisy, picture, layer.geometry, fit->samples, weights});
  if (absl::Status status = run->Finish(); !status.ok()) return status;
  std::vector<float> of_samples(count);
  absl::Status status = run->Read(weights, 0, count * sizeof(float), of_samples.data());
  for (const int32_t target : layout.targets) {
    const auto sample = static_cast<size_t>(target);
    if (layout.on_grid[sample] && of_samples[sample] > 0) fit->centres.push_back(target);
  }
  return status;
}

}  // namespace

LightLayout::LightLayout(const LayerCall& call, const RegressionParams& of) : params(of) {
  const auto width = static_cast<size_t>(call.halves.weight.width());
  const size_t pixels = width * static_cast<size_t>(call.halves.weight.height());
  const std::vector<PointsOfPixel> points = PointsByPixel(call);
  const auto points_at = [&](size_t pixel) { return points.empty() ? PointsOfPixel{} : points[pixel]; };
  FitLayout layout = MakeFitLayout(call.halves.is_mixed, WindowRadius(params), [&](int x, int y) {
    const int32_t count = points_at(static_cast<size_t>(y) * width + static_cast<size_t>(x)).count;
    return static_cast<size_t>(std::max(count, 1));
  });
  firsts = std::move(layout.firsts);
  targets = std::move(layout.targets);
  for (size_t pixel = 0; pixel < pixels; ++pixel) {
    if (firsts[pixel] == firsts[pixel + 1]) continue;
    const auto [first, count] = points_at(pixel);
    const int32_t site = count > 0 ? Int(pixels) + first : Int(pixel);
    for (int32_t i = 0; i < std::max(count, 1); ++i) sites.push_back(site + i);
    on_grid.resize(sites.size(), pixel % width % kFitStep == 0 && pixel / width % kFitStep == 0);
  }
  for (const int32_t target : targets) most_centres += on_grid[static_cast<size_t>(target)] ? 1 : 0;
  fit = {.shape = kLightShape,
         .window = {call.halves.weight.width(), call.halves.weight.height(), WindowRadius(params),
                    FalloffOf(params)},
         .slope = params.slope,
         .firsts = firsts,
         .targets = targets,
         .centres = {}};
}

DeviceMemory LightLayout::Need() const {
  return More(Together({sites.size(), sites.size()}), LeastMemory(fit, most_centres));
}

absl::Status RunLightFit(const LayerCall& call, const LightLayout& layout, const LayerPlanes& layer,
                         const DeviceMemory& memory, Buffer picture, Buffer fitted, KernelRun* run) {
  run->Copy(picture, 0, fitted, 0, LayerSizes::kPicturePlanes * layer.sizes.sites * sizeof(float));
  if (layout.targets.empty()) return absl::OkStatus();
  const Buffer sites = run->Upload(layout.sites), weights = run->Floats(layout.sites.size());
  FitOnDevice fit = layout.fit;
  if (absl::Status status = MakeSamples(call, layout, layer, picture, sites, weights, &fit, run);
      !status.ok())
    return status;
  const uint64_t lists = 2 * layout.sites.size() * sizeof(float);
  const absl::StatusOr<FittedOnDevice> found = RunDeviceFit(fit, Less(memory, {lists, 0}), run);
  if (!found.ok()) return found.status();
  run->Run("TakeFit", layout.targets.size(),
           {layer.sizes.grid, Int(layout.targets.size()), call.halves.level, found->targets, sites, weights,
            found->values, found->totals, fitted});
  return run->Finish();
}

}  // namespace lumifold::filter
