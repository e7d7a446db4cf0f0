#include "worker/render/geometry/edge_set.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "filter/image/layers.h"

namespace lumifold::render {
namespace {

constexpr float kMinCosine = 0.9f;         // between normals of one surface
constexpr float kDistanceRatio = 1.0513f;  // e^0.05

/// max(x, 1 / x).
float AtLeastOne(float x) { return std::max(x, 1.0f / x); }

/// The factor, at least 1, by which the distance along the centre rays changes from `from` to `to` on the
/// plane of `from`; infinite if one of the rays does not hit that plane.
float ChangeOnPlane(const EdgeProbe& from, const Ray& to) {
  const float here =
      Dot(from.geometric, from.position - from.centre.origin) / Dot(from.geometric, from.centre.direction);
  const float there = Dot(from.geometric, from.position - to.origin) / Dot(from.geometric, to.direction);
  if (!(here > 0 && there > 0)) return INFINITY;
  return AtLeastOne(there / here);
}

bool Disagree(std::span<const GeometrySample> samples, const EdgeProbe& mean) {
  return std::any_of(samples.begin(), samples.end(), [&](const GeometrySample& s) {
    if (s.hit != mean.hit || s.valid != mean.valid || s.instance != mean.instance) return true;
    return s.hit && Dot(s.normal, mean.normal) < kMinCosine;
  });
}

}  // namespace

EdgeProbe ProbeOf(std::span<const GeometrySample> samples, const Ray& centre) {
  EdgeProbe probe;
  probe.centre = centre;
  probe.hit = samples[0].hit;
  probe.valid = samples[0].valid;
  probe.instance = samples[0].instance;
  float hits = 0;
  for (const GeometrySample& s : samples) {
    if (!s.hit) continue;
    hits += 1;
    probe.normal += s.normal;
    probe.geometric += s.geometric;
    probe.position += s.position;
    probe.distance += s.distance;
  }
  if (hits > 0) {
    if (LengthSquared(probe.normal) > 0) probe.normal = Normalize(probe.normal);
    probe.position = probe.position / hits;
    probe.distance /= hits;
  }
  probe.mixed = Disagree(samples, probe);
  return probe;
}

bool IsEdgeBetween(const EdgeProbe& a, const EdgeProbe& b) {
  if (a.hit != b.hit || a.valid != b.valid || a.instance != b.instance) return true;
  if (!a.hit) return false;
  if (Dot(a.normal, b.normal) < kMinCosine) return true;
  const float change = AtLeastOne(a.distance / b.distance);
  return change > kDistanceRatio &&
         change > kDistanceRatio * std::max(ChangeOnPlane(a, b.centre), ChangeOnPlane(b, a.centre));
}

EdgeRows::EdgeRows() : rows_(layers::EdgeChannels(), kSubSamples) {}

void EdgeRows::Add(int x, int y, std::span<const GeometrySample, kSubSamples> samples) {
  for (const GeometrySample& s : samples) {
    rows_.Add(std::array{static_cast<float>(x), static_cast<float>(y), s.normal.x, s.normal.y, s.normal.z,
                         s.distance, s.albedo.x, s.albedo.y, s.albedo.z, s.emitted.x, s.emitted.y,
                         s.emitted.z, static_cast<float>(s.instance + 1), s.valid ? 1.0f : 0.0f});
  }
}

}  // namespace lumifold::render
