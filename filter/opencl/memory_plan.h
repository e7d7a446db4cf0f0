#pragma once

#include <cstdint>

#include "filter/manifold/filter_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// The sizes of one filtering by manifolds.
struct ManifoldSizes {
  explicit ManifoldSizes(const ManifoldCall& call);
  /// With patches of three channels that have `taps` in all.
  ManifoldSizes(const KernelOptions& kernels, const ManifoldParams& params, int width, int height,
                size_t points, size_t taps);

  KernelOptions options;
  Grid grid = {};
  uint64_t pixels = 0, sites = 0, cells = 0;
  uint64_t patches = 0;  // floats that their projection takes
  int32_t levels = 0, manifolds = 0;
};

/// How many manifolds are in the device's memory at a time. The order of sums is that of the manifolds,
/// whatever their number.
struct MemoryPlan {
  /// Clusters of a level whose sums over cells are there; all, or an even number.
  int32_t clusters = 1;
  /// Manifolds that are splatted, blurred and sliced together. Where these are not all, the weights of sites
  /// are computed again.
  int32_t manifolds = 1;
};

/// What a plan needs.
DeviceMemory NeedOf(const MemoryPlan& plan, const ManifoldSizes& sizes);

/// The smallest plan.
MemoryPlan LeastPlan(const ManifoldSizes& sizes);

/// The largest plan that the memory holds; it holds the smallest one.
MemoryPlan PlanFor(const DeviceMemory& memory, const ManifoldSizes& sizes);

}  // namespace lumifold::filter
