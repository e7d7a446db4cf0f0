#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Planes minus their mean under the mask and, if asked, over their deviation: what hardly varies at all
/// becomes 0. `means` may be null; the planes' means are appended to it.
Planes Standardise(const Planes& planes, ConstFloatView mask, bool to_unit_variance, TaskPool* pool,
                   std::vector<float>* means);

}  // namespace lumifold::filter
