#pragma once

#include <cmath>

#include "worker/scene/vec.h"

namespace lumifold::render {

using scene::Vec2;
using scene::Vec3;

/// A right-handed orthonormal basis whose z axis is a given unit vector.
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
struct Frame {
  Vec3 x;
  Vec3 y;
  Vec3 z;

  explicit Frame(Vec3 normal) : z(normal) {
    const float sign = std::copysign(1.0f, z.z);
    const float a = -1.0f / (sign + z.z);
    const float b = z.x * z.y * a;
    x = {1.0f + sign * z.x * z.x * a, sign * b, -sign * z.x};
    y = {b, sign + z.y * z.y * a, -z.y};
  }
  /// The same with x in the plane of the normal and `along`, if they span one.
  Frame(Vec3 normal, Vec3 along) : Frame(normal) {
    const Vec3 tangent = along - z * Dot(along, z);
    if (LengthSquared(tangent) <= 1e-8f) return;
    x = Normalize(tangent);
    y = Cross(z, x);
  }

  Vec3 ToLocal(Vec3 v) const { return {Dot(v, x), Dot(v, y), Dot(v, z)}; }
  Vec3 ToWorld(Vec3 v) const { return x * v.x + y * v.y + z * v.z; }
};

/// Maps the unit square to the unit disk; preserves relative areas and adjacency. Source: Shirley & Chiu
/// 1997.
inline Vec2 ConcentricDisk(Vec2 u) {
  const float a = 2.0f * u.x - 1.0f;
  const float b = 2.0f * u.y - 1.0f;
  if (a == 0 && b == 0) return {0, 0};
  const bool along_x = std::abs(a) > std::abs(b);
  const float radius = along_x ? a : b;
  // The angle from the nearer axis is at most pi / 4, where short series reach float precision.
  const float angle = 0.785398163f * (along_x ? b / a : a / b);
  const float x2 = angle * angle;
  const float sine = angle * (1.0f - x2 * (1.0f / 6) * (1.0f - x2 * (1.0f / 20) * (1.0f - x2 * (1.0f / 42))));
  const float cosine =
      1.0f - x2 * 0.5f * (1.0f - x2 * (1.0f / 12) * (1.0f - x2 * (1.0f / 30) * (1.0f - x2 * (1.0f / 56))));
  return along_x ? Vec2{radius * cosine, radius * sine} : Vec2{radius * sine, radius * cosine};
}

}  // namespace lumifold::render
