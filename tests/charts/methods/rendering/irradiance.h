#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "worker/render/path_tracer.h"
#include "worker/render/surface.h"

namespace lumifold::charts {

/// By how much a colour grows a metre, or a unit of the normal, in each direction of space: one vector a
/// channel.
using ColorGradient = std::array<scene::Vec3, 3>;

/// The gradient's product with a step.
inline scene::Vec3 AlongStep(const ColorGradient& gradient, scene::Vec3 step) {
  return {Dot(gradient[0], step), Dot(gradient[1], step), Dot(gradient[2], step)};
}

/// Rings of equal share of the cosine-weighted hemisphere, from the pole on, each cut into equal sectors.
struct HemisphereStrata {
  int rings = 0;
  int sectors = 0;

  /// About as wide as high: pi sectors a ring.
  static HemisphereStrata OfRings(int rings);
  /// As near to `rays` strata of that shape as can be.
  static HemisphereStrata OfRays(int rays);

  int count() const { return rings * sectors; }
  /// The direction at `jitter` within stratum number `index` (ring by ring), z along the normal.
  scene::Vec3 Direction(int index, scene::Vec2 jitter) const;
};

/// Indirect irradiance at a point of a surface.
struct Irradiance {
  scene::Vec3 value;        // W / m^2
  ColorGradient by_turn{};  // its growth with the normal: value + AlongStep(by_turn, n - normal)
  ColorGradient by_step{};  // and with the place
  float mean_distance = std::numeric_limits<float>::infinity();  // harmonic, of what is seen from there
};

/// The irradiance from one arrival for each stratum, in their order, at a surface whose normal is `normal`
/// and whose strata have their azimuth in `Frame(normal)`. Source: Ward & Heckbert 1992, "Irradiance
/// Gradients".
Irradiance IrradianceFrom(const HemisphereStrata& strata, scene::Vec3 normal,
                          std::span<const render::Arrival> arrivals);

/// Gathers one path for each stratum. `key` is the point's own: it decides the random numbers.
Irradiance GatherIrradiance(const render::PathTracer& tracer, const render::Surface& surface,
                            const HemisphereStrata& strata, uint64_t seed, int64_t key);

}  // namespace lumifold::charts
