#pragma once

#include "absl/status/statusor.h"
#include "filter/manifold/manifold_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// The kernels that the call needs.
KernelOptions KernelsOf(const ManifoldCall& call);

/// ManifoldFilterAtPoints by the kernels of manifold.cl, made for KernelsOf(call).
/// Errors: those of the run.
absl::StatusOr<ManifoldResult> RunManifolds(const ManifoldCall& call, KernelRun* run);

}  // namespace lumifold::filter
