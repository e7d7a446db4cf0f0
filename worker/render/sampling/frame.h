#pragma once

#include <algorithm>
#include <cmath>

#include "hwy/base.h"

#include "worker/scene/vec.h"

namespace lumifold::render {

using scene::Vec2;
using scene::Vec3;

/// What formulas that lanes share are made of where they are those of one sample.
namespace one {

using Num = float;
using Num2 = Vec2;
using Num3 = Vec3;
using Mask = bool;

inline bool Not(bool a) { return !a; }
inline bool Or(bool a, bool b) { return a || b; }
inline float Sqrt(float a) { return std::sqrt(a); }
inline float Abs(float a) { return std::abs(a); }
inline float Max(float a, float b) { return std::max(a, b); }
inline float CopySign(float magnitude, float sign) { return std::copysign(magnitude, sign); }
inline float Where(bool m, float yes) { return m ? yes : 0.0f; }
inline float Select(bool m, float yes, float no) { return m ? yes : no; }
inline Vec3 Select(bool m, Vec3 yes, Vec3 no) { return m ? yes : no; }

#include "worker/render/sampling/directions-inl.h"

}  // namespace one

using one::ConcentricDisk;
using one::CosineDirection;
using one::Frame;

/// The basis with x in the plane of the normal and `along`, if they span one.
inline Frame FrameAlong(Vec3 normal, Vec3 along) {
  Frame frame = Frame::Of(normal);
  const Vec3 tangent = along - normal * Dot(along, normal);
  if (LengthSquared(tangent) <= 1e-8f) return frame;
  frame.x = Normalize(tangent);
  frame.y = Cross(normal, frame.x);
  return frame;
}

}  // namespace lumifold::render
