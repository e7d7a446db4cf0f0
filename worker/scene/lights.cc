#include "worker/scene/lights.h"

#include <algorithm>
#include <limits>

#include "absl/strings/str_cat.h"
#include "filter/image/portable_math.h"
#include "worker/scene/fields.h"

namespace lumifold::scene {
namespace {

constexpr double kMaxFloat = std::numeric_limits<float>::max();

absl::StatusOr<PunctualLight::Kind> KindFrom(const std::string& type) {
  if (type == "point") return PunctualLight::Kind::kPoint;
  if (type == "spot") return PunctualLight::Kind::kSpot;
  if (type == "directional") return PunctualLight::Kind::kDirectional;
  return absl::InvalidArgumentError(absl::StrCat("type \"", type, "\" is not KHR_lights_punctual's"));
}

void ReadCone(const tinygltf::SpotLight& spot, FieldReader* fields, PunctualLight* light) {
  light->outer_cone_angle = fields->Clamped(spot.outerConeAngle, 1e-4, double{kPi} / 2, "outerConeAngle");
  light->inner_cone_angle = fields->Clamped(spot.innerConeAngle, 0, double{kPi} / 2, "innerConeAngle");
  // Exporters write equal angles for a sharp edge; the falloff between the angles must not divide by zero.
  constexpr float kSharpest = 0.999f;
  light->inner_cone_angle = std::min(light->inner_cone_angle, kSharpest * light->outer_cone_angle);
}

}  // namespace

absl::StatusOr<PunctualLight> ReadLight(const tinygltf::Light& source, const std::string& place,
                                        Diagnostics* diagnostics) {
  PunctualLight light;
  const auto kind = KindFrom(source.type);
  if (!kind.ok()) return WithContext(kind.status(), place);
  light.kind = *kind;
  FieldReader fields(place, diagnostics);
  if (source.color.size() == 3) {
    const auto channel = [&](size_t i) { return fields.Clamped(source.color[i], 0, kMaxFloat, "color"); };
    light.color = {channel(0), channel(1), channel(2)};
  } else if (!source.color.empty()) {
    fields.Fail("color is not an array of 3 numbers");
  }
  light.intensity = fields.Clamped(source.intensity, 0, kMaxFloat, "intensity");
  light.range = fields.Clamped(source.range, 0, kMaxFloat, "range");
  if (light.kind == PunctualLight::Kind::kSpot) ReadCone(source.spot, &fields, &light);
  if (!fields.status().ok()) return fields.status();
  return light;
}

}  // namespace lumifold::scene
