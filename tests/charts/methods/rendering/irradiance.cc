#include "tests/charts/methods/rendering/irradiance.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/mix_bits.h"
#include "filter/image/portable_math.h"

namespace lumifold::charts {
namespace {

using render::ChartsAccess;
using render::Frame;
using render::IndirectRadiance;
using render::IsFinite;
using render::kCameraPair;
using render::Sampler;
using render::Surface;
using scene::Vec2;
using scene::Vec3;

/// Separates the random numbers of gathered paths from those of camera samples of the same seed.
constexpr uint64_t kGatherSeed = 0x69727261643a3939u;

void Add(Vec3 amount, Vec3 direction, ColorGradient* gradient) {
  for (int c = 0; c < 3; ++c) (*gradient)[static_cast<size_t>(c)] += direction * amount[c];
}

/// The irradiance and its gradients from one set of strata, in the frame of the normal.
class GradientSums {
 public:
  GradientSums(const HemisphereStrata& strata, std::span<const IndirectRadiance> arrivals)
      : strata_(strata), arrivals_(arrivals), azimuth_step_(2 * kPi / static_cast<float>(strata.sectors)) {}

  Irradiance Sum() const {
    Irradiance sum;
    float inverse_distances = 0;
    for (int ring = 0; ring < strata_.rings; ++ring) {
      for (int sector = 0; sector < strata_.sectors; ++sector) {
        const IndirectRadiance& arrival = At(ring, sector);
        sum.value += arrival.radiance;
        inverse_distances += 1.0f / std::max(arrival.distance, kLeastDistance);
        AddTurn(ring, sector, &sum.by_turn);
        if (ring > 0) AddRadialStep(ring, sector, &sum.by_step);
        AddTangentialStep(ring, sector, &sum.by_step);
      }
    }
    const float share = kPi / static_cast<float>(strata_.count());
    sum.value *= share;
    for (Vec3& gradient : sum.by_turn) gradient *= share;
    if (inverse_distances > 0) sum.mean_distance = static_cast<float>(strata_.count()) / inverse_distances;
    return sum;
  }

 private:
  static constexpr float kLeastDistance = 1e-30f;

  const IndirectRadiance& At(int ring, int sector) const {
    return arrivals_[static_cast<size_t>(ring) * static_cast<size_t>(strata_.sectors) +
                     static_cast<size_t>(sector)];
  }
  /// The sine of the angle to the normal at the start of ring `ring`.
  float SineBefore(int ring) const {
    return std::sqrt(static_cast<float>(ring) / static_cast<float>(strata_.rings));
  }
  /// The integral of that angle's tangent over the part of the hemisphere before the ring. An integral,
  /// because the mean over the last ring is far from the tangent at its middle.
  float TangentsUpTo(int ring) const {
    const float sine = SineBefore(ring);
    const float cosine = std::sqrt(1 - sine * sine);
    return Atan2(sine, cosine) - sine * cosine;
  }

  Vec3 Azimuth(float sectors) const {
    Vec3 out;
    SinCos(azimuth_step_ * sectors, &out.y, &out.x);
    return out;
  }

  /// Rotation gradient: the cosine of each direction changes as the normal rotates. It is the limit of Ward
  /// and Heckbert's (n_i x n) . gradient, with their gradient rotated by 90 degrees around the normal.
  void AddTurn(int ring, int sector, ColorGradient* turn) const {
    const float tangent = (TangentsUpTo(ring + 1) - TangentsUpTo(ring)) * static_cast<float>(strata_.rings);
    Add(At(ring, sector).radiance * tangent, Azimuth(static_cast<float>(sector) + 0.5f), turn);
  }

  /// Translation gradient: the border to the stratum nearer to the pole moves with the nearer of the two
  /// surfaces.
  void AddRadialStep(int ring, int sector, ColorGradient* step) const {
    const IndirectRadiance& here = At(ring, sector);
    const IndirectRadiance& inner = At(ring - 1, sector);
    const float nearer = std::min(here.distance, inner.distance);
    if (!(nearer > kLeastDistance)) return;
    const float sine = SineBefore(ring);
    const float rate = azimuth_step_ * sine * (1 - sine * sine) / nearer;
    Add((here.radiance - inner.radiance) * rate, Azimuth(static_cast<float>(sector) + 0.5f), step);
  }

  /// The same for the border to the previous sector.
  void AddTangentialStep(int ring, int sector, ColorGradient* step) const {
    const IndirectRadiance& here = At(ring, sector);
    const IndirectRadiance& before = At(ring, sector > 0 ? sector - 1 : strata_.sectors - 1);
    const float nearer = std::min(here.distance, before.distance);
    if (!(nearer > kLeastDistance)) return;
    const float rate = (SineBefore(ring + 1) - SineBefore(ring)) / nearer;
    const Vec3 border = Azimuth(static_cast<float>(sector));
    Add((here.radiance - before.radiance) * rate, {-border.y, border.x, 0}, step);
  }

  HemisphereStrata strata_;
  std::span<const IndirectRadiance> arrivals_;
  float azimuth_step_;
};

}  // namespace

HemisphereStrata HemisphereStrata::OfRings(int rings) {
  return {rings, std::max(1, static_cast<int>(std::lround(kPi * static_cast<float>(rings))))};
}

HemisphereStrata HemisphereStrata::OfRays(int rays) {
  return OfRings(std::max(1, static_cast<int>(std::lround(std::sqrt(static_cast<float>(rays) / kPi)))));
}

Vec3 HemisphereStrata::Direction(int index, Vec2 jitter) const {
  const int ring = index / sectors;
  const int sector = index % sectors;
  const float squared_sine = (static_cast<float>(ring) + jitter.x) / static_cast<float>(rings);
  Vec3 out;
  SinCos(2 * kPi * (static_cast<float>(sector) + jitter.y) / static_cast<float>(sectors), &out.y, &out.x);
  const float sine = std::sqrt(squared_sine);
  return {out.x * sine, out.y * sine, std::sqrt(std::max(0.0f, 1 - squared_sine))};
}

Irradiance IrradianceFrom(const HemisphereStrata& strata, Vec3 normal,
                          std::span<const IndirectRadiance> arrivals) {
  LUMIFOLD_CHECK(static_cast<int>(arrivals.size()) == strata.count());
  Irradiance sum = GradientSums(strata, arrivals).Sum();
  const Frame frame = Frame::Of(normal);
  for (ColorGradient* gradient : {&sum.by_turn, &sum.by_step}) {
    for (Vec3& channel : *gradient) channel = frame.ToWorld(channel);
  }
  return sum;
}

Irradiance GatherIrradiance(const ChartsAccess& tracer, const Surface& surface,
                            const HemisphereStrata& strata, uint64_t seed, int64_t key) {
  const Frame frame = Frame::Of(surface.normal);
  std::vector<IndirectRadiance> arrivals(static_cast<size_t>(strata.count()));
  for (int i = 0; i < strata.count(); ++i) {
    const Sampler sampler(MixBits(seed ^ kGatherSeed), 0, key, static_cast<uint32_t>(i));
    const Vec3 direction = frame.ToWorld(strata.Direction(i, sampler.Get2D(kCameraPair)));
    // Part of the hemisphere of a shading normal may lie behind the face: no light arrives from there.
    if (Dot(direction, surface.geometric) <= 0) continue;
    IndirectRadiance arrival = tracer.TraceIndirect(surface, direction, sampler);
    if (IsFinite(arrival.radiance)) arrivals[static_cast<size_t>(i)] = arrival;
  }
  return IrradianceFrom(strata, surface.normal, arrivals);
}

}  // namespace lumifold::charts
