#pragma once

#include <cstddef>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/kernel_run.h"
#include "filter/opencl/memory_plan.h"

namespace lumifold::filter {

/// The kernels that the call needs.
KernelOptions KernelsOf(const ManifoldCall& call);

/// What a call needs at least.
DeviceMemory LeastMemory(const ManifoldCall& call);
/// What RunManifolds takes of so much memory.
DeviceMemory TakenMemory(const ManifoldCall& call, const DeviceMemory& memory);

/// A filtering whose planes of sites are on the device. Masks of points are 0.
struct SiteFiltering {
  const ManifoldSizes& sizes;
  const ManifoldParams& params;
  float reach;
  const SlicePoints& points;
  KernelRun::Buffer places;                    // x, y of each point
  KernelRun::Buffer features, signals, masks;  // released at the end, or before
};

/// What a filtering leaves on the device: planes of sites of the result, and what each point found.
struct FilteredSites {
  KernelRun::Buffer planes, found;
};

/// The program of the filtering runs; `use` gets its result, which stays until `use` returns. Errors: those
/// of the run and of `use`.
absl::Status RunFiltering(const SiteFiltering& filtering, const DeviceMemory& memory, KernelRun* run,
                          absl::FunctionRef<absl::Status(const FilteredSites&)> use);

/// The features of sites that are coordinates of patches: the first planes of `features`. The program is that
/// of a filtering. `color`: `channels` planes of pixels, in place of those of `patches`.
void ProjectPatches(const Grid& grid, const PatchProjection& patches, size_t channels,
                    KernelRun::Buffer color, KernelRun::Buffer features, KernelRun* run);

/// A picture as planes of sites.
struct SiteCounts {
  int width, height;
  size_t points, planes;
};
/// `planes` of them from plane `first` of the buffer on; without weights of points. Errors: those of the run.
absl::StatusOr<ManifoldResult> ReadSites(const SiteCounts& counts, KernelRun::Buffer from, size_t first,
                                         KernelRun* run);

/// FilterDevice::Filter by the kernels of manifold.cl, made for the call. Manifolds take turns as the memory
/// of the device asks for; the bits are the same. It holds LeastMemory(call). Errors: those of the run.
absl::StatusOr<ManifoldResult> RunManifolds(const ManifoldCall& call, const DeviceMemory& memory,
                                            KernelRun* run);

}  // namespace lumifold::filter
