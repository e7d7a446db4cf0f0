#include "worker/render/geometry/camera.h"

#include "filter/image/portable_math.h"
#include "worker/render/sampling/frame.h"

namespace lumifold::render {

using scene::Vec2;
using scene::Vec3;

namespace {

/// Metres; a full frame is 36 x 24 mm.
constexpr float kSensorHeight = 0.024f;

}  // namespace

PictureCamera::PictureCamera(const scene::Camera& camera, const Lens& lens, const FrameWindow& frame,
                             const PixelFilter& filter)
    : frame_(frame), filter_(filter), perspective_(camera.kind == scene::Camera::Kind::kPerspective) {
  pose_.position = camera.world_from_camera.origin;
  const Vec3 right = Normalize(camera.world_from_camera.x);
  const Vec3 up = Normalize(camera.world_from_camera.y);
  pose_.forward = -Normalize(camera.world_from_camera.z);
  const float aspect = static_cast<float>(frame.frame_width) / static_cast<float>(frame.frame_height);
  float half_height = camera.ymag;
  if (perspective_) {
    float sin_half = 0;
    float cos_half = 0;
    SinCos(0.5f * camera.yfov, &sin_half, &cos_half);
    half_height = sin_half / cos_half;
  }
  const float half_width = half_height * aspect;
  pose_.right = right;
  pose_.up = up;
  plane_.half_width = half_width;
  plane_.half_height = half_height;
  plane_.step_x = right * (2 * half_width / static_cast<float>(frame.frame_width));
  plane_.pixel = 2 * half_height / static_cast<float>(frame.frame_height);
  plane_.step_y = up * -plane_.pixel;
  plane_.corner = up * half_height - right * half_width;
  if (!perspective_) return;
  plane_.corner += pose_.forward;
  if (lens.f_stop <= 0) return;
  const float focal_length = 0.5f * kSensorHeight / half_height;
  const float radius = focal_length / (2 * lens.f_stop);
  lens_.focus = lens.focus_metres;
  lens_.x = right * radius;
  lens_.y = up * radius;
  lens_.blur = 2 * radius / (plane_.pixel * lens_.focus);
  has_lens_ = true;
}

PictureCamera::Matrix PictureCamera::WorldToCamera() const {
  const Vec3& r = pose_.right;
  const Vec3& u = pose_.up;
  const Vec3 b = -pose_.forward;
  return {r.x,
          u.x,
          b.x,
          0,  //
          r.y,
          u.y,
          b.y,
          0,  //
          r.z,
          u.z,
          b.z,
          0,  //
          -Dot(r, pose_.position),
          -Dot(u, pose_.position),
          -Dot(b, pose_.position),
          1};
}

PictureCamera::Matrix PictureCamera::WorldToNdc() const {
  // Depth is -1 in the near plane and goes to 1 with the distance; no ray depends on it.
  constexpr float kNear = 0.01f;
  Matrix projection = {};
  projection[0] = 1 / plane_.half_width;
  projection[5] = 1 / plane_.half_height;
  projection[10] = -1;
  projection[11] = perspective_ ? -1.0f : 0.0f;
  projection[14] = perspective_ ? -2 * kNear : 0.0f;
  projection[15] = perspective_ ? 0.0f : 1.0f;
  const Matrix world = WorldToCamera();
  Matrix product = {};
  for (size_t row = 0; row < 4; ++row) {
    for (size_t column = 0; column < 4; ++column) {
      for (size_t i = 0; i < 4; ++i)
        product[4 * row + column] += world[4 * row + i] * projection[4 * i + column];
    }
  }
  return product;
}

void PictureCamera::SetRay(Vec2 point, Vec2 lens, float pixels, Ray* ray) const {
  const Vec3 offset = plane_.corner + plane_.step_x * point.x + plane_.step_y * point.y;
  if (!perspective_) {
    ray->origin = pose_.position + offset;
    ray->direction = pose_.forward;
    ray->width = pixels * plane_.pixel;
    return;
  }
  const float stretch = 1.0f / Length(offset);
  ray->origin = pose_.position;
  ray->direction = offset * stretch;
  ray->spread = pixels * plane_.pixel * stretch;
  if (!has_lens_) return;
  const Vec2 disk = ConcentricDisk(lens);
  const Vec3 shift = lens_.x * disk.x + lens_.y * disk.y;
  ray->origin += shift;
  ray->direction = Normalize(offset * lens_.focus - shift);
}

}  // namespace lumifold::render
