#pragma once

#include "worker/render/embree_scene.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A thin lens. Its focal length is what gives the camera's vertical field of view on a sensor 24 mm high, as
/// in full-frame photography; its radius is the focal length over twice the f-stop.
struct Lens {
  float f_stop = 0;        // focal length over diameter; 0: a pinhole, everything is sharp
  float focus_metres = 0;  // distance along the view axis of the plane that is sharp
};

/// Turns points of the picture into rays. The picture's own aspect rules: the vertical field of view is the
/// camera's, and a wider picture sees more to the sides.
class PictureCamera {
 public:
  /// Orthographic cameras have no lens: theirs must be a pinhole.
  PictureCamera(const scene::Camera& camera, const Lens& lens, int width, int height);

  /// The ray through picture point (x, y) in pixels, origin top left, y down; pixel centres lie at .5. `lens`
  /// is where it passes the lens, evenly distributed over [0, 1)^2; a pinhole takes no notice. The cone round
  /// the ray is `pixels` wide.
  Ray RayThrough(float x, float y, scene::Vec2 lens, float pixels = 1) const {
    Ray ray;
    SetRay({x, y}, lens, pixels, &ray);
    return ray;
  }
  /// Makes `ray`, which must be new, the one through `point`.
  void SetRay(scene::Vec2 point, scene::Vec2 lens, float pixels, Ray* ray) const;

  bool HasLens() const { return has_lens_; }

  /// Distance of a world point from the camera along the view axis.
  float PlanarDepth(scene::Vec3 p) const { return Dot(p - position_, forward_); }

 private:
  bool perspective_;
  scene::Vec3 position_;
  scene::Vec3 forward_;
  scene::Vec3
      corner_;  // of the picture at distance 1 (perspective) or in the camera's plane, relative to position_
  scene::Vec3 step_x_;  // one pixel to the right
  scene::Vec3 step_y_;  // one pixel down
  float pixel_ = 0;     // its length
  bool has_lens_ = false;
  float focus_ = 1;
  scene::Vec3 lens_x_;  // the lens's radius to the right
  scene::Vec3 lens_y_;  // the same up
};

}  // namespace lumifold::render
