#include "worker/scene/directions.h"

#include <cmath>

namespace lumifold::scene {

std::optional<Vec3> UnitVector(Vec3 v) {
  const double x = v.x, y = v.y, z = v.z;
  const double length = std::sqrt(x * x + y * y + z * z);
  if (!(length > 0)) return std::nullopt;
  return Vec3{static_cast<float>(x / length), static_cast<float>(y / length), static_cast<float>(z / length)};
}

Vec3 Perpendicular(Vec3 n) {
  return Normalize(Cross(n, std::fabs(n.x) < 0.5f ? Vec3{1, 0, 0} : Vec3{0, 1, 0}));
}

}  // namespace lumifold::scene
