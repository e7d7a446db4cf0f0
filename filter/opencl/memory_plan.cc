#include "filter/opencl/memory_plan.h"

#include <algorithm>

#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/opencl/manifold_run.h"

namespace lumifold::filter {

ManifoldSizes::ManifoldSizes(const KernelOptions& kernels, const ManifoldParams& params, int width,
                             int height, size_t points, size_t taps)
    : options(kernels), levels(params.height), manifolds((int32_t{1} << params.height) - 1) {
  const Lattice lattice(width, height, options.step);
  grid = {lattice.width, lattice.height, lattice.Columns(), lattice.Rows(), static_cast<int32_t>(points)};
  pixels = static_cast<uint64_t>(grid.width) * static_cast<uint64_t>(grid.height);
  sites = pixels + points;
  cells = static_cast<uint64_t>(grid.columns) * static_cast<uint64_t>(grid.rows);
  if (taps > 0) patches = 3 * pixels + taps;
}

ManifoldSizes::ManifoldSizes(const ManifoldCall& call)
    : ManifoldSizes(KernelsOf(call), call.params, call.mask.width(), call.mask.height(),
                    call.points != nullptr ? call.points->pixels.size() : 0, 0) {
  if (call.patches.dimensions > 0) patches = call.patches.color.size() * pixels + call.patches.taps.size();
}

DeviceMemory NeedOf(const MemoryPlan& plan, const ManifoldSizes& sizes) {
  const auto features = static_cast<uint64_t>(sizes.options.features);
  const auto planes = static_cast<uint64_t>(sizes.options.planes());
  const auto channels = static_cast<uint64_t>(sizes.options.channels);
  const auto manifolds = static_cast<uint64_t>(plan.manifolds);
  const auto clusters = static_cast<uint64_t>(plan.clusters);
  const auto points = static_cast<uint64_t>(sizes.grid.points);
  const bool is_whole = plan.manifolds == sizes.manifolds;
  const uint64_t all_features = features * sizes.sites, weights = manifolds * sizes.sites;
  const uint64_t eta = static_cast<uint64_t>(sizes.manifolds) * sizes.cells * features;
  const uint64_t sums = clusters * sizes.cells * (features + 1);
  // Entries of covariances, each a double, of at most twice kAxisRows rows.
  const uint64_t covariances = 2 * clusters * (features * (features + 1) / 2 + 1) * (2 * kAxisRows + 1);
  const uint64_t axes = features << (sizes.levels - 1);
  const uint64_t signals = channels * sizes.sites;
  const DeviceMemory projection = Together({all_features, signals, 2 * points, sizes.sites, sizes.patches});
  const DeviceMemory tree =
      Together({all_features, signals, 2 * points, sizes.sites, eta, is_whole ? weights : 0, sums, sums,
                sizes.sites, 3 * sizes.pixels, covariances, axes});
  const DeviceMemory rest =
      Together({is_whole ? 0 : all_features, 4 * points, sizes.sites, eta, weights, signals, sizes.sites,
                manifolds * sizes.cells * planes, manifolds * sizes.cells, manifolds * sizes.cells,
                (is_whole ? channels : planes) * sizes.sites, axes, sizes.cells + 1, points});
  return {std::max({projection.whole, tree.whole, rest.whole}),
          std::max({projection.largest, tree.largest, rest.largest})};
}

MemoryPlan LeastPlan(const ManifoldSizes& sizes) { return {std::min(2, 1 << (sizes.levels - 1)), 1}; }

MemoryPlan PlanFor(const DeviceMemory& memory, const ManifoldSizes& sizes) {
  const MemoryPlan least = LeastPlan(sizes);
  MemoryPlan plan = least;
  for (int32_t count = sizes.manifolds; count > 1; --count) {
    if (!memory.Holds(NeedOf({least.clusters, count}, sizes))) continue;
    plan.manifolds = count;
    break;
  }
  for (int32_t count = 1 << (sizes.levels - 1); count > least.clusters; count /= 2) {
    if (!memory.Holds(NeedOf({count, plan.manifolds}, sizes))) continue;
    plan.clusters = count;
    break;
  }
  return plan;
}

}  // namespace lumifold::filter
