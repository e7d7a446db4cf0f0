#pragma once

#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// The oracle of ManifoldFilterAtPoints: the same mathematics written plainly, one manifold at a time, whole
/// planes in double, no bands.
ManifoldResult ManifoldFilterSlow(const Planes& signals, const Planes& features, ConstFloatView mask,
                                  const ManifoldParams& params, float reach, const SlicePoints* points);

}  // namespace lumifold::filter
