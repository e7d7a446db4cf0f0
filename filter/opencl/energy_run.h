#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "filter/manifold/layer_call.h"
#include "filter/opencl/kernel_run.h"
#include "filter/opencl/layer_planes.h"

namespace lumifold::filter {

/// Of pixels: three of each half.
inline constexpr uint64_t kEnergyPlanes = 6;

/// What RunEnergy needs at least, beside its buffers.
DeviceMemory EnergyNeed(const LayerCall& call, const RemovedLight& removed, const LayerSizes& sizes);
/// What it takes of so much memory.
DeviceMemory TakenByEnergy(const LayerCall& call, const RemovedLight& removed, const LayerSizes& sizes,
                           const DeviceMemory& memory);

/// ReturnRemoved (filter/denoise/firefly.h) on the device: makes `energy` what returns to the light of
/// `picture`. `removed`, `energy`: six planes of pixels. `memory`: what is left to it.
/// Errors: those of the run, whose program becomes that of layers.
absl::Status RunEnergy(const LayerCall& call, const RemovedLight& light, const LayerPlanes& layer,
                       const DeviceMemory& memory, KernelRun::Buffer picture, KernelRun::Buffer removed,
                       KernelRun::Buffer energy, KernelRun* run);

}  // namespace lumifold::filter
