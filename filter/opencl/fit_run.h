#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/manifold/fit_call.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// What a call needs at least.
DeviceMemory LeastMemory(const FitCall& call);
/// What RunFit takes of so much memory.
DeviceMemory TakenMemory(const FitCall& call, const DeviceMemory& memory);

/// A fit whose samples are on the device; the rest as FitCall has it.
struct FitOnDevice {
  FitShape shape;
  FitWindow window = {};
  float slope = 1;
  absl::Span<const int32_t> firsts, targets;
  std::vector<int32_t> centres;  // numbers of the samples that are centres of models, ascending
  KernelRun::Buffer samples = {};
};
/// What it needs at least with so many centres, with its samples.
DeviceMemory LeastMemory(const FitOnDevice& fit, uint64_t centres);

/// What a fit leaves on the device, as FitResult has it.
struct FittedOnDevice {
  KernelRun::Buffer targets = {}, values = {}, totals = {};
};
/// `memory`: what is left to it, with its samples. Errors: those of the run, whose program becomes its own.
absl::StatusOr<FittedOnDevice> RunDeviceFit(const FitOnDevice& fit, const DeviceMemory& memory,
                                            KernelRun* run);

/// FilterDevice::Fit by the kernels of fit.cl, made for the call's shape. As many models at a time are
/// fitted as `memory` has room for their sums; the bits are the same. It holds LeastMemory(call).
/// Errors: those of the run.
absl::StatusOr<FitResult> RunFit(const FitCall& call, const DeviceMemory& memory, KernelRun* run);

}  // namespace lumifold::filter
