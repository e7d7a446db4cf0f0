#pragma once

#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// ManifoldFilterAtPoints as an oracle: the same mathematics written plainly, one manifold at a time, whole
/// planes in double, no bands.
ManifoldResult ManifoldFilterOracle(const Planes& signals, const Planes& features, ConstFloatView mask,
                                    const ManifoldParams& params, float reach, const SlicePoints* points);

}  // namespace lumifold::filter
