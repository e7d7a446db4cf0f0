#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/manifold/manifold_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// The kernels that the call needs.
KernelOptions KernelsOf(const ManifoldCall& call);

/// What the calls need at least.
DeviceMemory LeastMemory(absl::Span<const ManifoldCall> calls);
/// What RunManifolds takes of so much memory.
DeviceMemory TakenMemory(absl::Span<const ManifoldCall> calls, const DeviceMemory& memory);

/// ManifoldDevice::Filter by the kernels of manifold.cl, made for the calls. Manifolds take turns as the
/// memory of the device asks for, and planes of several calls stay there if it has room; the bits are the
/// same. `memory` holds LeastMemory(calls). Errors: those of the run.
absl::StatusOr<std::vector<ManifoldResult>> RunManifolds(absl::Span<const ManifoldCall> calls,
                                                         const DeviceMemory& memory, KernelRun* run);

}  // namespace lumifold::filter
