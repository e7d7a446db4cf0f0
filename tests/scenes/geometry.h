#pragma once

#include <cmath>
#include <numbers>

namespace lumifold::scenes {

struct Vec2 {
  double x = 0, y = 0;
};

struct Vec3 {
  double x = 0, y = 0, z = 0;

  friend bool operator==(const Vec3&, const Vec3&) = default;
};

inline Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
inline Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
inline Vec2 operator*(Vec2 a, double s) { return {a.x * s, a.y * s}; }
inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
inline Vec3 operator*(Vec3 a, double s) { return {a.x * s, a.y * s, a.z * s}; }
inline Vec3 operator*(Vec3 a, Vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }

inline double Dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 Cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double Length(Vec2 a) { return std::sqrt(a.x * a.x + a.y * a.y); }
inline double Length(Vec3 a) { return std::sqrt(Dot(a, a)); }
/// Returns the zero vector for the zero vector.
inline Vec3 Normalized(Vec3 a) {
  const double length = Length(a);
  return length > 0 ? a * (1 / length) : a;
}

inline double Mix(double a, double b, double t) { return a + (b - a) * t; }
inline Vec3 Mix(Vec3 a, Vec3 b, double t) { return a + (b - a) * t; }
inline double Clamp01(double t) { return t < 0 ? 0 : t > 1 ? 1 : t; }
/// Smoothstep: 0 below `edge0`, 1 above `edge1`.
inline double SmoothStep(double edge0, double edge1, double x) {
  const double t = Clamp01((x - edge0) / (edge1 - edge0));
  return t * t * (3 - 2 * t);
}
inline double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

/// A unit quaternion, in glTF's order.
struct Rotation {
  double x = 0, y = 0, z = 0, w = 1;

  static Rotation AboutAxis(Vec3 unit_axis, double degrees);
  static Rotation Yaw(double degrees) { return AboutAxis({0, 1, 0}, degrees); }
};
/// The rotation that applies `second` after `first`.
Rotation operator*(Rotation second, Rotation first);

/// world = translation + rotation * (scale * local), as in a glTF node.
struct Transform {
  Vec3 translation = {};
  Rotation rotation = {};
  Vec3 scale = {1, 1, 1};

  /// A camera's pose: local -Z points from `eye` to `target`, local +Y is as close to world up as possible.
  /// `target` must not be vertically above or below `eye`.
  static Transform LookingAt(Vec3 eye, Vec3 target);

  Vec3 Point(Vec3 local) const;
  /// Transforms a unit normal; the result is a unit vector.
  Vec3 Normal(Vec3 local) const;
};

}  // namespace lumifold::scenes
