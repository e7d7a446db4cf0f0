#pragma once

#include "absl/status/statusor.h"
#include "filter/manifold/manifold_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// What the call needs.
DeviceMemory MemoryOf(const ProjectionCall& call);

/// ProjectPatches by the kernel of projection.cl, made for Kernels::kProjection.
/// Errors: those of the run.
absl::StatusOr<Planes> RunProjection(const ProjectionCall& call, KernelRun* run);

}  // namespace lumifold::filter
