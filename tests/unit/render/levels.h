#pragma once

#include "filter/image/layers.h"

namespace lumifold::render {

inline constexpr layers::Level kReflection1 = {layers::Branch::kReflection, 1};
inline constexpr layers::Level kReflection2 = {layers::Branch::kReflection, 2};
inline constexpr layers::Level kReflection3 = {layers::Branch::kReflection, 3};
inline constexpr layers::Level kTransmission1 = {layers::Branch::kTransmission, 1};
inline constexpr layers::Level kTransmission2 = {layers::Branch::kTransmission, 2};

}  // namespace lumifold::render
