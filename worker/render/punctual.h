#pragma once

#include "worker/scene/scene.h"

namespace lumifold::render {

/// glTF gives lights without size in candela and lux, but the renderer counts watts, as emissive surfaces do.
/// Exporters that start from watts, Blender among them, write 683 lumens for each: the luminous efficacy of
/// light of 555 nm, by which the candela is defined. Dividing by the same number gives back what the artist
/// set.
inline constexpr float kLumensPerWatt = 683.0f;

/// A light without size as shading points see it. Source: KHR_lights_punctual.
class PunctualEmitter {
 public:
  explicit PunctualEmitter(const scene::PunctualLight& light);

  /// Whether it is infinitely far away.
  bool IsDirectional() const { return kind_ == scene::PunctualLight::Kind::kDirectional; }

  scene::Vec3 position() const { return position_; }
  /// The way a spot or a directional light shines.
  scene::Vec3 axis() const { return axis_; }
  /// Of a spot: the cosine of the angle to the axis beyond which it is dark; -1 for a point.
  float cos_outer() const { return cos_outer_; }

  /// Irradiance, in W/m^2, of a surface at `point` that faces the light: squared distance, range and cone
  /// included. `to_light` is the unit direction to it, `distance` how far it is.
  scene::Vec3 Irradiance(scene::Vec3 to_light, float distance) const;

  /// Luminance of all it radiates: of a directional light, into a disk of `scene_radius`.
  double Power(double scene_radius) const;

 private:
  scene::PunctualLight::Kind kind_;
  scene::Vec3 position_;
  scene::Vec3 axis_;
  scene::Vec3 intensity_;    // W/sr, of directional lights W/m^2
  float inverse_range_ = 0;  // 0: no end
  float cone_scale_ = 0;     // brightness of a spot: (cos * scale + offset)^2
  float cone_offset_ = 1;
  float cos_inner_ = -1;
  float cos_outer_ = -1;
};

}  // namespace lumifold::render
