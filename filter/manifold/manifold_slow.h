#pragma once

#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// ManifoldFilter as its definition reads: a recursion over the tree, in double, one pixel after another. For
/// tests.
Planes ManifoldFilterSlow(const Planes& signals, const Planes& features, ConstFloatView mask,
                          const ManifoldParams& params);

}  // namespace lumifold::filter
