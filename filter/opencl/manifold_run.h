#pragma once

#include <cstddef>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/device_planes.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// The kernels that the call needs.
KernelOptions KernelsOf(const ManifoldCall& call);

/// What the calls need at least.
DeviceMemory LeastMemory(absl::Span<const ManifoldCall> calls);
/// What RunManifolds takes of so much memory.
DeviceMemory TakenMemory(absl::Span<const ManifoldCall> calls, const DeviceMemory& memory);

/// How calls use the device's memory.
struct CallsPlan {
  bool planes_stay = false;
  DeviceMemory of_calls;  // what is left to each
  DeviceMemory taken = {0, 0};
};
/// `after`: what is there with the planes of the calls once these are done.
CallsPlan PlanOf(absl::Span<const ManifoldCall> calls, const DeviceMemory& memory, const DeviceMemory& after);

/// What a call leaves on the device: planes of sites of the result and of the signals, and what each point
/// found.
struct FilteredSites {
  KernelRun::Buffer planes, signals, found;
};

/// A picture as planes of sites.
struct SiteCounts {
  int width, height;
  size_t points, planes;
};
/// `planes` of them from plane `first` of the buffer on; without weights of points. Errors: those of the run.
absl::StatusOr<ManifoldResult> ReadSites(const SiteCounts& counts, KernelRun::Buffer from, size_t first,
                                         KernelRun* run);

/// Runs the calls one after another; `use` gets the number of each and its result, which stays until `use`
/// returns. `memory`: of each call. Errors: those of the run and of `use`.
absl::Status RunEach(absl::Span<const ManifoldCall> calls, const DeviceMemory& memory, DevicePlanes* planes,
                     KernelRun* run, absl::FunctionRef<absl::Status(size_t, const FilteredSites&)> use);

/// FilterDevice::Filter by the kernels of manifold.cl, made for the calls. Manifolds take turns as the
/// memory of the device asks for, and planes of several calls stay there if it has room; the bits are the
/// same. `memory` holds LeastMemory(calls). Errors: those of the run.
absl::StatusOr<std::vector<ManifoldResult>> RunManifolds(absl::Span<const ManifoldCall> calls,
                                                         const DeviceMemory& memory, KernelRun* run);

}  // namespace lumifold::filter
