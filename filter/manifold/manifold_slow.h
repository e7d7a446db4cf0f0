#pragma once

#include "absl/types/span.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// The oracle of ManifoldFilterAtReaches: the same mathematics written plainly, one manifold at a time, whole
/// planes in double, no bands.
ManifoldResult ManifoldFilterSlow(const Planes& signals, const Planes& features, ConstFloatView mask,
                                  const ManifoldParams& params, absl::Span<const float> reaches,
                                  const SlicePoints* points);

}  // namespace lumifold::filter
