#include "worker/render/camera.h"

#include "filter/image/portable_math.h"
#include "worker/render/frame.h"

namespace lumifold::render {

using scene::Vec2;
using scene::Vec3;

namespace {

/// Metres; a full frame is 36 x 24 mm.
constexpr float kSensorHeight = 0.024f;

}  // namespace

PictureCamera::PictureCamera(const scene::Camera& camera, const Lens& lens, int width, int height)
    : perspective_(camera.kind == scene::Camera::Kind::kPerspective),
      position_(camera.world_from_camera.origin) {
  const Vec3 right = Normalize(camera.world_from_camera.x);
  const Vec3 up = Normalize(camera.world_from_camera.y);
  forward_ = -Normalize(camera.world_from_camera.z);
  const float aspect = static_cast<float>(width) / static_cast<float>(height);
  float half_height = camera.ymag;
  if (perspective_) {
    float sin_half = 0;
    float cos_half = 0;
    SinCos(0.5f * camera.yfov, &sin_half, &cos_half);
    half_height = sin_half / cos_half;
  }
  const float half_width = half_height * aspect;
  step_x_ = right * (2 * half_width / static_cast<float>(width));
  pixel_ = 2 * half_height / static_cast<float>(height);
  step_y_ = up * -pixel_;
  corner_ = up * half_height - right * half_width;
  if (!perspective_) return;
  corner_ += forward_;
  if (lens.f_stop <= 0) return;
  const float focal_length = 0.5f * kSensorHeight / half_height;
  const float radius = focal_length / (2 * lens.f_stop);
  focus_ = lens.focus_metres;
  lens_x_ = right * radius;
  lens_y_ = up * radius;
  has_lens_ = true;
}

void PictureCamera::SetRay(Vec2 point, Vec2 lens, float pixels, Ray* ray) const {
  const Vec3 offset = corner_ + step_x_ * point.x + step_y_ * point.y;
  if (!perspective_) {
    ray->origin = position_ + offset;
    ray->direction = forward_;
    ray->width = pixels * pixel_;
    return;
  }
  const float stretch = 1.0f / Length(offset);
  ray->origin = position_;
  ray->direction = offset * stretch;
  ray->spread = pixels * pixel_ * stretch;
  if (!has_lens_) return;
  const Vec2 disk = ConcentricDisk(lens);
  const Vec3 shift = lens_x_ * disk.x + lens_y_ * disk.y;
  ray->origin += shift;
  ray->direction = Normalize(offset * focus_ - shift);
}

}  // namespace lumifold::render
