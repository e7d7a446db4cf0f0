#include "worker/render/lights/punctual.h"

#include <algorithm>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"

namespace lumifold::render {

using scene::PunctualLight;
using scene::Vec3;

namespace {

float Cosine(float angle) {
  float sine = 0;
  float cosine = 0;
  SinCos(angle, &sine, &cosine);
  return cosine;
}

}  // namespace

PunctualEmitter::PunctualEmitter(const PunctualLight& light)
    : kind_(light.kind),
      position_(light.world_from_light.origin),
      axis_(-Normalize(light.world_from_light.z)),
      intensity_(light.color * (light.intensity / kLumensPerWatt)) {
  if (!IsDirectional() && light.range > 0) inverse_range_ = 1.0f / light.range;
  if (kind_ != PunctualLight::Kind::kSpot) return;
  cos_inner_ = Cosine(light.inner_cone_angle);
  cos_outer_ = Cosine(light.outer_cone_angle);
  cone_scale_ = 1.0f / std::max(0.001f, cos_inner_ - cos_outer_);  // the bound is the specification's
  cone_offset_ = -cos_outer_ * cone_scale_;
}

Vec3 PunctualEmitter::Irradiance(Vec3 to_light, float distance) const {
  if (IsDirectional()) return intensity_;
  float factor = 1.0f / (distance * distance);
  const float reach = distance * inverse_range_;
  factor *= std::max(0.0f, 1.0f - (reach * reach) * (reach * reach));
  const float cone = std::clamp(cone_offset_ - Dot(axis_, to_light) * cone_scale_, 0.0f, 1.0f);
  return intensity_ * (factor * cone * cone);
}

double PunctualEmitter::Intensity() const {
  return static_cast<double>(Luminance(intensity_.x, intensity_.y, intensity_.z));
}

double PunctualEmitter::Power(double scene_radius) const {
  const double luminance = Intensity();
  const double pi = static_cast<double>(kPi);
  if (IsDirectional()) return luminance * pi * scene_radius * scene_radius;
  if (kind_ == PunctualLight::Kind::kPoint) return luminance * 4 * pi;
  const double inner = static_cast<double>(cos_inner_);
  const double outer = static_cast<double>(cos_outer_);
  return luminance * 2 * pi * ((1 - inner) + (inner - outer) / 3);
}

}  // namespace lumifold::render
