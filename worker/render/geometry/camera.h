#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include "worker/render/sampling/pixel_filter.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A thin lens. Its focal length follows from the camera's vertical field of view and a sensor 24 mm high, as
/// in full-frame photography. Its radius is the focal length over twice the f-stop.
struct Lens {
  float f_stop = 0;        // focal length over diameter; 0: a pinhole, everything is in focus
  float focus_metres = 0;  // distance of the plane of focus along the view axis
};

/// The part of the frame that is the picture.
struct FrameWindow {
  int frame_width = 0;  // pixels of the whole frame; 0: the picture is the whole frame
  int frame_height = 0;
  int x = 0;  // pixel of the frame at the picture's top left corner
  int y = 0;
};

/// Generates camera rays. The vertical field of view is the camera's; the horizontal one follows from the
/// frame's aspect ratio.
class PictureCamera {
 public:
  /// An orthographic camera must have a pinhole. `frame` has the size of the whole frame.
  PictureCamera(const scene::Camera& camera, const Lens& lens, const FrameWindow& frame,
                const PixelFilter& filter = {});

  /// The frame's point for random numbers `u` in [0, 1)^2, in the pixel (x, y) of the picture or near it: see
  /// PixelFilter.
  scene::Vec2 PointIn(int x, int y, scene::Vec2 u) const {
    return {static_cast<float>(x + frame_.x) + filter_.Warp(u.x),
            static_cast<float>(y + frame_.y) + filter_.Warp(u.y)};
  }
  /// Row-major number in the frame of a pixel of the picture.
  int64_t NumberOf(int x, int y) const {
    return static_cast<int64_t>(y + frame_.y) * frame_.frame_width + x + frame_.x;
  }
  /// In pixels.
  float FilterWidth() const { return filter_.width(); }

  /// The ray through the frame's point (x, y) in pixels, origin top left, y down; pixel centres lie at .5.
  /// `lens` in [0, 1)^2 maps uniformly to the lens; a pinhole ignores it. The ray's cone is `pixels` wide.
  Ray RayThrough(float x, float y, scene::Vec2 lens, float pixels = 1) const {
    Ray ray;
    SetRay({x, y}, lens, pixels, &ray);
    return ray;
  }
  /// Sets `ray`, which must be new, to the ray through `point`.
  void SetRay(scene::Vec2 point, scene::Vec2 lens, float pixels, Ray* ray) const;

  bool HasLens() const { return has_lens_; }
  /// Diameter in pixels of the disc that the lens makes of a point at this distance along the view axis,
  /// which may be infinite; 0 for a pinhole.
  float BlurAt(float planar_depth) const { return lens_.blur * std::abs(1 - lens_.focus / planar_depth); }

  /// For row vectors, row by row: to a space that looks down its -Z with +Y up, and from it to the whole
  /// frame, -1 to 1 from left to right and from bottom to top.
  using Matrix = std::array<float, 16>;
  Matrix WorldToCamera() const;
  Matrix WorldToNdc() const;

  /// Where all rays of a perspective camera begin; nothing for an orthographic one.
  std::optional<scene::Vec3> Viewpoint() const {
    return perspective_ ? std::optional(pose_.position) : std::nullopt;
  }

  /// Distance of a world point from the camera along the view axis.
  float PlanarDepth(scene::Vec3 p) const { return Dot(p - pose_.position, pose_.forward); }

 private:
  /// Where the camera stands and looks, in world space.
  struct Pose {
    scene::Vec3 position;
    scene::Vec3 right;
    scene::Vec3 up;
    scene::Vec3 forward;
  };
  /// The frame at distance 1 (perspective) or in the camera's plane.
  struct ImagePlane {
    float half_width = 1;
    float half_height = 1;
    scene::Vec3 corner;  // top left, relative to the position
    scene::Vec3 step_x;  // one pixel to the right
    scene::Vec3 step_y;  // one pixel down
    float pixel = 0;     // length of step_y
  };
  struct Aperture {
    float focus = 1;  // as Lens::focus_metres
    scene::Vec3 x;    // the lens's radius, to the right
    scene::Vec3 y;    // the lens's radius, up
    float blur = 0;   // its diameter in pixels of the plane of focus
  };

  FrameWindow frame_;
  PixelFilter filter_;
  bool perspective_;
  Pose pose_;
  ImagePlane plane_;
  bool has_lens_ = false;
  Aperture lens_;
};

}  // namespace lumifold::render
