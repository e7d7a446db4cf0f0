#pragma once

#include "absl/status/statusor.h"
#include "filter/manifold/layer_call.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// What a call needs at least.
DeviceMemory LeastMemory(const LayerCall& call);
/// What RunLayerCall takes of so much memory.
DeviceMemory TakenMemory(const LayerCall& call, const DeviceMemory& memory);

/// FilterDevice::FilterLayer by kernels. Manifolds and models of the fit take turns as the memory asks for;
/// the bits are the same. It holds LeastMemory(call). Errors: those of the run.
absl::StatusOr<LayerResult> RunLayerCall(const LayerCall& call, const DeviceMemory& memory, KernelRun* run);

}  // namespace lumifold::filter
