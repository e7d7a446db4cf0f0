#include "worker/render/lights/studio.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

using scene::Vec3;

constexpr int kWidth = 256;
constexpr int kHeight = 128;

/// A round lamp with a soft rim.
struct Lamp {
  Vec3 towards;    // not normalised
  float radiance;  // at its middle
  float cos_rim;   // of the angle at which its light ends
  float cos_core;  // of the angle up to which it is whole
};

constexpr std::array<Lamp, 3> kLamps = {{
    {{-0.65f, 0.75f, 0.6f}, 2.2f, 0.80f, 0.90f},  // key
    {{0.9f, 0.25f, 0.45f}, 0.4f, 0.55f, 0.80f},   // fill
    {{0.35f, 0.95f, -0.6f}, 2.0f, 0.88f, 0.94f},  // rim
}};

float SmoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

float RadianceFrom(Vec3 direction) {
  // Walls up to the ceiling, and a floor that is darkest straight below.
  float radiance = 0.22f + 0.28f * SmoothStep(-1.0f, 0.6f, direction.y);
  for (const Lamp& lamp : kLamps)
    radiance +=
        lamp.radiance * SmoothStep(lamp.cos_rim, lamp.cos_core, Dot(direction, Normalize(lamp.towards)));
  return radiance;
}

/// The direction of a texel's middle: the picture's middle column lies at +X, a quarter to the right at +Z.
Vec3 DirectionOf(int column, int row) {
  const float azimuth = 2 * kPi * ((static_cast<float>(column) + 0.5f) / kWidth - 0.5f);
  const float polar = kPi * (static_cast<float>(row) + 0.5f) / kHeight;
  float sin_azimuth = 0, cos_azimuth = 1, sin_polar = 0, cos_polar = 1;
  SinCos(azimuth, &sin_azimuth, &cos_azimuth);
  SinCos(polar, &sin_polar, &cos_polar);
  return {sin_polar * cos_azimuth, cos_polar, sin_polar * sin_azimuth};
}

}  // namespace

LayeredImage StudioPicture() {
  LayeredImage picture(kWidth, kHeight);
  const ColorView color = picture.AddColor("");
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const float radiance = RadianceFrom(DirectionOf(x, y));
      for (const FloatView& channel : color) channel.At(x, y) = radiance;
    }
  }
  return picture;
}

std::shared_ptr<const Environment> StudioEnvironment() {
  static const auto* const studio = [] {
    auto made = Environment::Create(StudioPicture(), /*rotate_degrees=*/0, /*scale=*/1);
    LUMIFOLD_CHECK(made.ok());
    return new std::shared_ptr<const Environment>(*std::move(made));
  }();
  return *studio;
}

}  // namespace lumifold::render
