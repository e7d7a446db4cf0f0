#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Subtracts from each plane its mean under the mask and, if `to_unit_variance`, divides by its standard
/// deviation; a plane that hardly varies (deviation up to 1e-4) becomes 0. `means` may be null; the planes'
/// means are appended to it.
Planes Standardise(const Planes& planes, ConstFloatView mask, bool to_unit_variance, TaskPool* pool,
                   std::vector<float>* means);

}  // namespace lumifold::filter
