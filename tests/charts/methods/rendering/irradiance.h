#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "tests/charts/access/charts_access.h"
#include "worker/render/tracing/surface.h"

namespace lumifold::charts {

/// The gradient of a colour with respect to position (per metre) or normal: one vector per channel.
using ColorGradient = std::array<scene::Vec3, 3>;

/// The product of the gradient with a step.
inline scene::Vec3 AlongStep(const ColorGradient& gradient, scene::Vec3 step) {
  return {Dot(gradient[0], step), Dot(gradient[1], step), Dot(gradient[2], step)};
}

/// Strata of the cosine-weighted hemisphere: rings of equal weight, from the pole outwards, in equal sectors.
struct HemisphereStrata {
  int rings = 0;
  int sectors = 0;

  /// Strata about as wide as high: pi sectors per ring.
  static HemisphereStrata OfRings(int rings);
  /// About `rays` strata of that shape.
  static HemisphereStrata OfRays(int rays);

  int count() const { return rings * sectors; }
  /// The direction at `jitter` inside stratum `index`, which counts ring by ring; z is the normal.
  scene::Vec3 Direction(int index, scene::Vec2 jitter) const;
};

/// Indirect irradiance at a point of a surface.
struct Irradiance {
  scene::Vec3 value;        // W / m^2
  ColorGradient by_turn{};  // rotation gradient: value + AlongStep(by_turn, n - normal)
  ColorGradient by_step{};  // translation gradient
  float mean_distance =
      std::numeric_limits<float>::infinity();  // harmonic mean distance of the surfaces seen from there
};

/// The irradiance from the incident radiance of each stratum, in their order, at a surface with `normal`. The
/// azimuth of strata is that of `Frame::Of(normal)`. Source: Ward & Heckbert 1992, "Irradiance Gradients".
Irradiance IrradianceFrom(const HemisphereStrata& strata, scene::Vec3 normal,
                          std::span<const render::IndirectRadiance> arrivals);

/// Estimates the irradiance with one path per stratum. `key` identifies the point and selects the random
/// numbers.
Irradiance GatherIrradiance(const render::ChartsAccess& tracer, const render::Surface& surface,
                            const HemisphereStrata& strata, uint64_t seed, int64_t key);

}  // namespace lumifold::charts
