#pragma once

#include "absl/status/statusor.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// What a call needs at least.
DeviceMemory LeastMemory(const RefineCall& call);
/// What RunRefinement takes of so much memory.
DeviceMemory TakenMemory(const RefineCall& call, const DeviceMemory& memory);

/// FilterDevice::Refine by the kernels of manifold.cl and choice.cl. What filterings make stays on the
/// device. `memory` holds LeastMemory(call); the bits are the same with more. Errors: those of the run.
absl::StatusOr<RefinedHalves> RunRefinement(const RefineCall& call, const DeviceMemory& memory,
                                            KernelRun* run);

}  // namespace lumifold::filter
