#pragma once

#include <array>
#include <cmath>

namespace lumifold::scene {

struct Vec2 {
  float x = 0;
  float y = 0;
};

/// A point, a direction or linear RGB.
struct Vec3 {
  float x = 0;
  float y = 0;
  float z = 0;

  constexpr float operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  friend constexpr bool operator==(const Vec3&, const Vec3&) = default;
};

struct Vec4 {
  float x = 0;
  float y = 0;
  float z = 0;
  float w = 0;
};

constexpr Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
constexpr Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
constexpr Vec2 operator*(Vec2 a, float s) { return {a.x * s, a.y * s}; }
constexpr Vec2& operator+=(Vec2& a, Vec2 b) { return a = a + b; }

constexpr Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
constexpr Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
constexpr Vec3 operator*(Vec3 a, Vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
constexpr Vec3 operator*(Vec3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
constexpr Vec3 operator*(float s, Vec3 a) { return a * s; }
constexpr Vec3 operator/(Vec3 a, float s) { return {a.x / s, a.y / s, a.z / s}; }
constexpr Vec3& operator+=(Vec3& a, Vec3 b) { return a = a + b; }
constexpr Vec3& operator*=(Vec3& a, Vec3 b) { return a = a * b; }
constexpr Vec3& operator*=(Vec3& a, float s) { return a = a * s; }

constexpr float Dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
constexpr Vec3 Cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
constexpr float LengthSquared(Vec3 a) { return Dot(a, a); }
inline float Length(Vec3 a) { return std::sqrt(Dot(a, a)); }
/// a scaled to length 1; a must not be zero.
inline Vec3 Normalize(Vec3 a) { return a * (1.0f / Length(a)); }
constexpr float MaxComponent(Vec3 a) { return a.x > a.y ? (a.x > a.z ? a.x : a.z) : (a.y > a.z ? a.y : a.z); }
constexpr Vec3 Lerp(Vec3 a, Vec3 b, float t) { return a * (1.0f - t) + b * t; }

/// An affine transform; the columns are the images of the x, y and z axes and of the origin.
struct Affine {
  Vec3 x = {1, 0, 0};
  Vec3 y = {0, 1, 0};
  Vec3 z = {0, 0, 1};
  Vec3 origin = {0, 0, 0};

  constexpr Vec3 Point(Vec3 p) const { return x * p.x + y * p.y + z * p.z + origin; }
  constexpr Vec3 Vector(Vec3 v) const { return x * v.x + y * v.y + z * v.z; }
  /// Determinant of the linear part; negative for mirroring transforms, 0 for singular ones.
  constexpr float Determinant() const { return Dot(x, Cross(y, z)); }
  /// Transforms a normal by the cofactor matrix, which is correct for any scaling; not of unit length. Under
  /// mirroring transforms the normal stays on the outer side.
  constexpr Vec3 Normal(Vec3 n) const {
    const float side = Determinant() < 0 ? -1.0f : 1.0f;
    return (Cross(y, z) * n.x + Cross(z, x) * n.y + Cross(x, y) * n.z) * side;
  }

  friend constexpr bool operator==(const Affine&, const Affine&) = default;
};

/// The transform that applies b, then a.
constexpr Affine operator*(const Affine& a, const Affine& b) {
  return {a.Vector(b.x), a.Vector(b.y), a.Vector(b.z), a.Point(b.origin)};
}

}  // namespace lumifold::scene
