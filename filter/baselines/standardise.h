#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Planes after (plane - mean) * scale.
struct StandardPlanes {
  Planes planes;
  std::vector<float> means;
  std::vector<float> scales;  // 0 for a plane that hardly varies
};

/// Subtracts from each plane its mean under the mask and, if `to_unit_variance`, divides by its standard
/// deviation; a plane that hardly varies (deviation up to 1e-4) becomes 0.
StandardPlanes Standardise(const Planes& planes, ConstFloatView mask, bool to_unit_variance, TaskPool* pool);

}  // namespace lumifold::filter
