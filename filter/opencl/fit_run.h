#pragma once

#include "absl/status/statusor.h"
#include "filter/manifold/fit_call.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// What a call needs at least.
DeviceMemory LeastMemory(const FitCall& call);
/// What RunFit takes of so much memory.
DeviceMemory TakenMemory(const FitCall& call, const DeviceMemory& memory);

/// ManifoldDevice::Fit by the kernels of fit.cl, made for the call's shape. As many models at a time are
/// fitted as `memory` has room for their sums; the bits are the same. It holds LeastMemory(call).
/// Errors: those of the run.
absl::StatusOr<FitResult> RunFit(const FitCall& call, const DeviceMemory& memory, KernelRun* run);

}  // namespace lumifold::filter
