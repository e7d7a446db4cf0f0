#pragma once

#include "worker/render/embree_scene.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A thin lens. Its focal length follows from the camera's vertical field of view and a sensor 24 mm high, as
/// in full-frame photography. Its radius is the focal length over twice the f-stop.
struct Lens {
  float f_stop = 0;        // focal length over diameter; 0: a pinhole, everything is in focus
  float focus_metres = 0;  // distance of the plane of focus along the view axis
};

/// Generates camera rays. The vertical field of view is the camera's; the horizontal one follows from the
/// picture's aspect ratio.
class PictureCamera {
 public:
  /// An orthographic camera must have a pinhole.
  PictureCamera(const scene::Camera& camera, const Lens& lens, int width, int height);

  /// The ray through picture point (x, y) in pixels, origin top left, y down; pixel centres lie at .5. `lens`
  /// in [0, 1)^2 maps uniformly to the lens; a pinhole ignores it. The ray's cone is `pixels` wide.
  Ray RayThrough(float x, float y, scene::Vec2 lens, float pixels = 1) const {
    Ray ray;
    SetRay({x, y}, lens, pixels, &ray);
    return ray;
  }
  /// Sets `ray`, which must be new, to the ray through `point`.
  void SetRay(scene::Vec2 point, scene::Vec2 lens, float pixels, Ray* ray) const;

  bool HasLens() const { return has_lens_; }

  /// Distance of a world point from the camera along the view axis.
  float PlanarDepth(scene::Vec3 p) const { return Dot(p - position_, forward_); }

 private:
  bool perspective_;
  scene::Vec3 position_;
  scene::Vec3 forward_;
  /// The picture's top left corner at distance 1 (perspective) or in the camera's plane, relative to
  /// position_.
  scene::Vec3 corner_;
  scene::Vec3 step_x_;  // one pixel to the right
  scene::Vec3 step_y_;  // one pixel down
  float pixel_ = 0;     // length of step_y_
  bool has_lens_ = false;
  float focus_ = 1;
  scene::Vec3 lens_x_;  // the lens's radius, to the right
  scene::Vec3 lens_y_;  // the lens's radius, up
};

}  // namespace lumifold::render
