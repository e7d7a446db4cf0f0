#pragma once

#include <memory>

#include "filter/image/planes.h"
#include "filter/manifold/filter_device.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/nlm_space.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// ManifoldFilterAtPoints by the kernels of filter/opencl/manifold.cl, compiled as C++ and run a work-item
/// after another: the same bits. Checks that the device's memory holds what is allocated.
ManifoldResult ManifoldFilterOracle(const Planes& signals, const Planes& features, ConstFloatView mask,
                                    const ManifoldParams& params, float reach, const SlicePoints* points,
                                    const DeviceMemory& memory = {});

/// FilterDevice::Filter by the same.
ManifoldResult FilterOracle(const ManifoldCall& call, const DeviceMemory& memory);

/// A pool whose device does all that devices do by the same; in as little memory as it can where it
/// `is_small`.
std::unique_ptr<TaskPool> PoolWithOracle(bool is_small);

/// ProjectPatches by the kernel of projection.cl.
Planes ProjectPatchesOracle(const Planes& color, const PatchBasis& basis);

}  // namespace lumifold::filter
