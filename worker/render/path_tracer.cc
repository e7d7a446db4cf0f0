#include "worker/render/path_tracer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

/// A path is never ended by chance before this many scatterings: short paths carry most of the light.
constexpr int kFirstRouletteBounce = 2;

/// The dimension pairs a surface uses; they follow the camera's.
enum Pair : uint32_t { kLightAndLobe, kLightPoint, kDirection, kPairsPerSurface };

uint32_t PairOf(int bounce, Pair pair) {
  return kLensPair + 1 + static_cast<uint32_t>(bounce) * kPairsPerSurface + pair;
}

Vec3 TotalOf(const BsdfValue& value, Vec3 albedo) { return albedo * value.diffuse + value.specular; }

LightReceiver ReceiverAt(const Surface& surface) { return {surface.position, surface.normal}; }

/// The ray that is free where the light reaches the surface.
Ray ShadowRay(const Surface& surface, const LightSample& sample) {
  const Vec3 origin = surface.Offset(sample.direction);
  if (sample.infinite) return {origin, sample.direction};
  constexpr float kStopShort = 1.0f - 0x1p-12f;  // the light itself must not be in its own way
  const Vec3 segment = sample.position - origin;
  const float length = Length(segment);
  return {origin, segment / length, length * kStopShort};
}

/// Beer's law along `distance` metres inside a volume.
Vec3 Attenuation(const scene::Material& material, float distance) {
  if (material.attenuation_distance <= 0) return {1, 1, 1};
  const float lengths = distance / material.attenuation_distance;
  const Vec3 c = material.attenuation_color;
  return {Pow(c.x, lengths), Pow(c.y, lengths), Pow(c.z, lengths)};
}

}  // namespace

/// Radiance that arrives at the first surface along the drawn direction, apart by the number of steps it
/// came.
struct PathTracer::Tail {
  Vec3 one_step;
  Vec3 longer;
};

PathTracer::PathTracer(const scene::Scene& scene, const EmbreeScene& embree,
                       std::shared_ptr<const Environment> environment, int max_bounces,
                       LightStrategy strategy)
    : embree_(&embree),
      textures_(scene),
      surfaces_(scene, textures_),
      lights_(scene, textures_, std::move(environment)),
      albedo_table_(AlbedosOf(scene)),
      visibility_(scene, embree, surfaces_, albedo_table_),
      max_bounces_(max_bounces),
      strategy_(strategy) {}

Bsdf PathTracer::MakeBsdf(const Surface& surface, Vec3 wo) const {
  return {surfaces_.Shade(surface), albedo_table_, surface.normal, surface.geometric, wo};
}

float PathTracer::MisWeight(LightStrategy own_strategy, float own, float other) const {
  if (strategy_ == LightStrategy::kCombined) return own / (own + other);
  return strategy_ == own_strategy ? 1.0f : 0.0f;
}

BsdfValue PathTracer::ConnectToLight(const Surface& surface, const Bsdf& bsdf, float pick, Vec2 u,
                                     Vec3* light) const {
  if (lights_.IsEmpty() || !bsdf.HasSmoothLobe()) return {};
  const LightSample sample = lights_.Sample(ReceiverAt(surface), pick, u);
  if (sample.pdf <= 0 || MaxComponent(sample.radiance) <= 0) return {};
  float bsdf_pdf = 0;
  BsdfValue value = bsdf.Evaluate(sample.direction, &bsdf_pdf);
  if (value.diffuse <= 0 && MaxComponent(value.specular) <= 0) return {};
  const float weight =
      sample.without_size ? 1.0f : MisWeight(LightStrategy::kLightSamples, sample.pdf, bsdf_pdf);
  if (weight <= 0) return {};
  const Vec3 through = visibility_.Transmittance(ShadowRay(surface, sample));
  if (MaxComponent(through) <= 0) return {};
  *light = sample.radiance * through * (weight / sample.pdf);
  return value;
}

Vec3 PathTracer::EmittedOnHit(const LightReceiver& from, const Surface& surface, const Hit& hit,
                              Vec3 direction, float pdf) const {
  const Vec3 emitted = surfaces_.Emitted(surface);
  if (pdf <= 0 || MaxComponent(emitted) <= 0)
    return emitted;  // no light sample could have made this connection
  const float cos_light = std::abs(Dot(direction, surface.geometric));
  const float distance = Length(surface.position - from.position);  // clear panes may lie between
  const float light_pdf = lights_.DensityOfHit(from, hit.instance, hit.triangle, distance, cos_light);
  if (light_pdf <= 0) return emitted;
  return emitted * MisWeight(LightStrategy::kBsdfHits, pdf, light_pdf);
}

Vec3 PathTracer::EmittedOnMiss(Vec3 direction, float pdf) const {
  if (!lights_.HasEnvironment()) return {0, 0, 0};
  const Vec3 radiance = lights_.SkyRadiance(direction);
  const float light_pdf = pdf > 0 ? lights_.SkyDensity(direction) : 0.0f;
  if (light_pdf <= 0) return radiance;
  return radiance * MisWeight(LightStrategy::kBsdfHits, pdf, light_pdf);
}

void PathTracer::TraceTail(const Surface& first, const BsdfSample& start, Vec3 visible,
                           const Sampler& sampler, Tail* tail) const {
  Surface surface = first;
  BsdfSample step = start;
  Vec3 throughput = {1, 1, 1};
  // Where the path last scattered, clear panes apart, and the density of the direction it took there.
  LightReceiver from = ReceiverAt(first);
  float pdf = start.pdf;
  int scatterings = start.straight ? 0 : 1;
  for (int bounce = 1;; ++bounce) {
    const Ray ray = surface.Leave(step, sampler.Key(PairOf(bounce, kDirection)));
    const Hit hit = embree_->Intersect(ray);
    Vec3& arrival = scatterings <= 1 ? tail->one_step : tail->longer;
    if (hit.IsMiss()) {
      arrival += throughput * EmittedOnMiss(ray.direction, pdf);
      return;
    }
    surface = surfaces_.Read(hit, ray);
    if (!surface.front && surface.material->has_volume)
      throughput *= Attenuation(*surface.material, hit.distance);
    arrival += throughput * EmittedOnHit(from, surface, hit, ray.direction, pdf);
    if (scatterings > max_bounces_) return;

    const Bsdf bsdf = MakeBsdf(surface, -ray.direction);
    const Vec2 light_and_lobe = sampler.Get2D(PairOf(bounce, kLightAndLobe));
    Vec3 light;
    const BsdfValue value =
        ConnectToLight(surface, bsdf, light_and_lobe.x, sampler.Get2D(PairOf(bounce, kLightPoint)), &light);
    tail->longer += throughput * TotalOf(value, bsdf.DiffuseAlbedo()) * light;

    step = bsdf.Sample(light_and_lobe.y, sampler.Get2D(PairOf(bounce, kDirection)));
    if (!step.valid) return;
    throughput *= TotalOf(step.weight, bsdf.DiffuseAlbedo());
    if (bounce >= kFirstRouletteBounce) {
      const float survive = std::min(1.0f, MaxComponent(visible * throughput));
      if (step.spare >= survive) return;
      throughput = throughput / survive;
    }
    if (step.straight) continue;
    from = ReceiverAt(surface);
    pdf = step.pdf;
    ++scatterings;
  }
}

LayerSample PathTracer::Trace(const Ray& camera_ray, const Sampler& sampler) const {
  LayerSample out;
  Ray ray = camera_ray;
  ray.chance = sampler.Key(kCameraPair);
  const Hit hit = embree_->Intersect(ray);
  if (hit.IsMiss()) {
    out.emitted = EmittedOnMiss(ray.direction, 0);
    out.combined = out.emitted;
    return out;
  }
  const Surface surface = surfaces_.Read(hit, ray);
  out.emitted = surfaces_.Emitted(surface);
  out.combined = out.emitted;

  const Bsdf bsdf = MakeBsdf(surface, -ray.direction);
  out.albedo = bsdf.DiffuseAlbedo();
  const Vec2 light_and_lobe = sampler.Get2D(PairOf(0, kLightAndLobe));
  Vec3 light;
  const BsdfValue value =
      ConnectToLight(surface, bsdf, light_and_lobe.x, sampler.Get2D(PairOf(0, kLightPoint)), &light);
  out.direct = light * value.diffuse;
  out.reflected = light * value.specular;
  out.combined += light * TotalOf(value, out.albedo);

  const BsdfSample step = bsdf.Sample(light_and_lobe.y, sampler.Get2D(PairOf(0, kDirection)));
  if (!step.valid) return out;
  Tail tail;
  const Vec3 visible = TotalOf(step.weight, out.albedo);
  TraceTail(surface, step, visible, sampler, &tail);
  out.direct += tail.one_step * step.weight.diffuse;
  out.indirect = tail.longer * step.weight.diffuse;
  out.reflected += (tail.one_step + tail.longer) * step.weight.specular;
  out.combined += visible * (tail.one_step + tail.longer);
  return out;
}

GeometrySample PathTracer::TraceGeometry(const Ray& ray) const {
  GeometrySample out;
  const Hit hit = embree_->Intersect(ray);
  if (hit.IsMiss()) return out;
  const Surface surface = surfaces_.Read(hit, ray);
  out.hit = true;
  out.valid = MakeBsdf(surface, -ray.direction).HasDiffuse();
  out.position = surface.position;
  out.normal = surface.normal;
  out.distance = hit.distance;
  out.instance = hit.instance;
  return out;
}

}  // namespace lumifold::render
