#pragma once

#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// ManifoldFilterAtPoints by the kernels of filter/opencl/manifold.cl, compiled as C++ and run a work-item
/// after another: the same bits.
ManifoldResult ManifoldFilterOracle(const Planes& signals, const Planes& features, ConstFloatView mask,
                                    const ManifoldParams& params, float reach, const SlicePoints* points);

}  // namespace lumifold::filter
