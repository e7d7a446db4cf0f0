#pragma once

#include "absl/status/statusor.h"
#include "filter/manifold/manifold_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// The kernels that the call needs.
KernelOptions KernelsOf(const ManifoldCall& call);

/// What the call needs at least.
DeviceMemory LeastMemory(const ManifoldCall& call);
/// What RunManifolds takes of so much memory.
DeviceMemory TakenMemory(const ManifoldCall& call, const DeviceMemory& memory);

/// ManifoldFilterAtPoints by the kernels of manifold.cl, made for KernelsOf(call). Manifolds take turns as
/// the memory of the device asks for; the bits are the same. `memory` holds LeastMemory(call). Errors: those
/// of the run.
absl::StatusOr<ManifoldResult> RunManifolds(const ManifoldCall& call, const DeviceMemory& memory,
                                            KernelRun* run);

}  // namespace lumifold::filter
