#pragma once

#include "worker/scene/scene.h"

namespace lumifold::render {

/// glTF gives punctual lights in candela and lux; the renderer computes in watts, like emissive surfaces.
/// Exporters that start from watts, Blender among them, write 683 lumens for each watt: the luminous efficacy
/// of light of 555 nm, by which the candela is defined. Dividing by the same number restores the artist's
/// value.
inline constexpr float kLumensPerWatt = 683.0f;

/// A punctual (delta) light: point, spot or directional. Source: KHR_lights_punctual.
class PunctualEmitter {
 public:
  explicit PunctualEmitter(const scene::PunctualLight& light);

  /// Whether the light is infinitely far away.
  bool IsDirectional() const { return kind_ == scene::PunctualLight::Kind::kDirectional; }

  scene::Vec3 position() const { return position_; }
  /// The direction in which a spot or a directional light emits.
  scene::Vec3 axis() const { return axis_; }
  /// Cosine of the angle to the axis beyond which a spot emits nothing; -1 for a point.
  float cos_outer() const { return cos_outer_; }

  /// Irradiance, in W/m^2, of a surface that faces the light, including inverse square falloff, range and
  /// cone. `to_light` is the unit direction to the light, `distance` its distance in metres.
  scene::Vec3 Irradiance(scene::Vec3 to_light, float distance) const;

  /// Emitted power as luminance; for a directional light, the power through a disk of `scene_radius`.
  double Power(double scene_radius) const;
  /// Intensity along the axis, as luminance; of a directional light the irradiance.
  double Intensity() const;

 private:
  scene::PunctualLight::Kind kind_;
  scene::Vec3 position_;
  scene::Vec3 axis_;
  scene::Vec3 intensity_;    // W/sr; W/m^2 for directional lights
  float inverse_range_ = 0;  // 0: unlimited
  float cone_scale_ = 0;     // a spot's falloff is (cos * scale + offset)^2
  float cone_offset_ = 1;
  float cos_inner_ = -1;
  float cos_outer_ = -1;
};

}  // namespace lumifold::render
