#include "tests/scenes/geometry.h"

namespace lumifold::scenes {
namespace {

Vec3 Rotate(Rotation r, Vec3 v) {
  const Vec3 axis = {r.x, r.y, r.z};
  const Vec3 t = Cross(axis, v) * 2;
  return v + t * r.w + Cross(axis, t);
}

}  // namespace

Rotation Rotation::AboutAxis(Vec3 unit_axis, double degrees) {
  const double s = std::sin(Radians(degrees) / 2);
  return {unit_axis.x * s, unit_axis.y * s, unit_axis.z * s, std::cos(Radians(degrees) / 2)};
}

Rotation operator*(Rotation a, Rotation b) {
  return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
          a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}

Transform Transform::LookingAt(Vec3 eye, Vec3 target) {
  const Vec3 forward = Normalized(target - eye);
  // Yaw rotates -Z to the target's azimuth, pitch to its elevation. The half-angle formulas need no atan2.
  const double ground = std::sqrt(forward.x * forward.x + forward.z * forward.z);
  const double cos_yaw = -forward.z / ground;
  const double sin_yaw = -forward.x / ground;
  const auto half = [](double sine, double cosine) {
    const double half_sine = std::sqrt(std::fmax(0, (1 - cosine) / 2));
    return Vec2{sine < 0 ? -half_sine : half_sine, std::sqrt(std::fmax(0, (1 + cosine) / 2))};
  };
  const Vec2 yaw = half(sin_yaw, cos_yaw);
  const Vec2 pitch = half(forward.y, ground);
  return {eye, Rotation{0, yaw.x, 0, yaw.y} * Rotation{pitch.x, 0, 0, pitch.y}};
}

Vec3 Transform::Point(Vec3 local) const { return translation + Rotate(rotation, local * scale); }

Vec3 Transform::Normal(Vec3 local) const {
  return Normalized(Rotate(rotation, {local.x / scale.x, local.y / scale.y, local.z / scale.z}));
}

}  // namespace lumifold::scenes
