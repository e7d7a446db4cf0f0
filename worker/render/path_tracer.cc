#include "worker/render/path_tracer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

/// A path is never ended by chance before this many scatterings: short paths carry most of the light.
constexpr int kFirstRouletteBounce = 2;

/// The dimension pairs a surface uses; they follow the camera's.
enum Pair : uint32_t { kLightAndLobe, kLightPoint, kDirection, kPairsPerSurface };

/// Where the pairs of the branch through glass begin, past all that the other one can use.
constexpr uint32_t kTransmissionPairs = 1u << 16;

/// Below this albedo a lobe's radiance is not divided by it.
constexpr float kLeastAlbedo = 1e-6f;

Vec3 TotalOf(const BsdfValue& value, Vec3 albedo) { return albedo * value.diffuse + value.specular; }

LightReceiver ReceiverAt(const Surface& surface) { return {surface.position, surface.normal}; }

/// Makes a new ray the one that is free where the light reaches the surface.
void SetShadowRay(const Surface& surface, const LightSample& sample, Ray* ray) {
  ray->origin = surface.Offset(sample.direction);
  ray->direction = sample.direction;
  if (std::isinf(sample.distance)) return;
  constexpr float kStopShort = 1.0f - 0x1p-12f;  // the light itself must not be in its own way
  // Towards the very point: a ray parallel to that way meets a lamp seen at a grazing angle long before it.
  const Vec3 segment = surface.position + sample.direction * sample.distance - ray->origin;
  const float length = Length(segment);
  ray->direction = segment * (1.0f / length);
  ray->max_distance = length * kStopShort;
}

/// Beer's law along `distance` metres inside a volume.
Vec3 Attenuation(const scene::Material& material, float distance) {
  if (material.attenuation_distance <= 0) return {1, 1, 1};
  const float lengths = distance / material.attenuation_distance;
  const Vec3 c = material.attenuation_color;
  return {Pow(c.x, lengths), Pow(c.y, lengths), Pow(c.z, lengths)};
}

/// Russian roulette before a step: ends the path by chance where `seen`, about its throughput after the step,
/// is low; gives the probability that it lives on, which the step's weight is to be divided by, and 0 where
/// it has ended. `number` decides, and is random in [0, 1) again afterwards.
float Survive(Vec3 seen, float* number) {
  const float survive = std::min(1.0f, MaxComponent(seen));
  if (*number >= survive) return 0;
  *number = std::min(*number / survive, 0x1.fffffep-1f);
  return survive;
}

/// Writes a lobe's radiance as G and S; channels without S are left to the tail.
void Demodulate(Vec3 radiance, Vec3 albedo, LayerSample* out) {
  const auto over = [](float value, float by) { return by > kLeastAlbedo ? value / by : 0.0f; };
  const auto rest = [](float value, float by) { return by > kLeastAlbedo ? 0.0f : value; };
  out->specular = albedo;
  out->glossy = {over(radiance.x, albedo.x), over(radiance.y, albedo.y), over(radiance.z, albedo.z)};
  out->tail = {rest(radiance.x, albedo.x), rest(radiance.y, albedo.y), rest(radiance.z, albedo.z)};
}

}  // namespace

/// One path's random numbers: a few dimension pairs of the sample a surface. Branches of one sample begin
/// theirs far apart.
class PathTracer::Numbers {
 public:
  explicit Numbers(const Sampler& sampler, uint32_t first_pair = kCameraPair + 1)
      : sampler_(&sampler), first_pair_(first_pair) {}

  Vec2 Get(int bounce, Pair pair) const { return sampler_->Get2D(PairOf(bounce, pair)); }
  /// The chance of the ray that leaves surface number `bounce`.
  uint64_t Chance(int bounce) const { return sampler_->Key(PairOf(bounce, kDirection)); }

 private:
  uint32_t PairOf(int bounce, Pair pair) const {
    return first_pair_ + static_cast<uint32_t>(bounce) * kPairsPerSurface + pair;
  }

  const Sampler* sampler_;
  uint32_t first_pair_;
};

/// What a light that was drawn sends to a surface, and how that scatters it to the viewer.
struct PathTracer::Connection {
  BsdfValue value;
  Vec3 light;  // black: there is none
  Ray ray;     // that must be free

  bool IsDark() const { return MaxComponent(light) <= 0; }
};

/// A path's next ray, where the path last scattered, clear panes apart, and the density its direction was
/// drawn with there; 0 where it was not by chance.
struct PathTracer::Departure {
  Ray ray;
  LightReceiver from;
  float pdf = 0;

  Departure(const Surface& surface, const BsdfSample& step, uint64_t chance) { Set(surface, step, chance); }

  void Set(const Surface& surface, const BsdfSample& step, uint64_t chance) {
    surface.Leave(step, chance, &ray);
    from = ReceiverAt(surface);
    pdf = step.pdf;
  }
};

/// Radiance that arrives along a ray, apart by the number of steps it came.
struct PathTracer::Tail {
  Vec3 one_step;
  Vec3 longer;
  float first_step = 0;  // metres to the first surface that is no clear pane; infinity where there is none
};

/// What a surface sends on to its viewer by its lobes that are not perfectly specular, and the perfectly
/// specular event that was drawn to follow, if one was.
struct PathTracer::Scattering {
  Vec3 direct;    // by the diffuse lobe, albedo left out, of light that came in one step
  Vec3 indirect;  // the same of light that came by longer ways
  Vec3 specular;  // by all other lobes
  Vec3 total;     // all of it, albedo included
  BsdfSample event;
};

/// Where a camera ray ends, and the light drawn there.
struct PathTracer::FirstSurface {
  Surface surface;
  Bsdf bsdf;
  Connection connection;
  float lobe;  // the random number that chooses how the path goes on

  FirstSurface(const PathTracer& tracer, const Hit& hit, const Ray& ray, const Numbers& numbers)
      : FirstSurface(tracer, hit, ray, numbers, numbers.Get(0, kLightAndLobe)) {}

 private:
  FirstSurface(const PathTracer& tracer, const Hit& hit, const Ray& ray, const Numbers& numbers,
               Vec2 light_and_lobe)
      : surface(tracer.surfaces_.Read(hit, ray)),
        bsdf(tracer.MakeBsdf(surface, -ray.direction)),
        connection(tracer.DrawLight(surface, bsdf, light_and_lobe.x, numbers, 0)),
        lobe(light_and_lobe.y) {}
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
  if (surface.values != nullptr)
    return {*surface.values, albedo_table_, surface.normal, surface.geometric, wo};
  return {surfaces_.Shade(surface), albedo_table_, surface.normal, surface.geometric, wo};
}

float PathTracer::HitWeight(float bsdf_pdf, float light_pdf) const {
  if (strategy_ == LightStrategy::kCombined) return bsdf_pdf / (bsdf_pdf + light_pdf);
  return strategy_ == LightStrategy::kBsdfHits ? 1.0f : 0.0f;
}

float PathTracer::LightSampleWeight(const LightSample& sample, float bsdf_pdf) const {
  if (sample.without_size || strategy_ == LightStrategy::kLightSamples) return 1.0f / sample.pdf;
  return strategy_ == LightStrategy::kCombined ? 1.0f / (sample.pdf + bsdf_pdf) : 0.0f;
}

PathTracer::Connection PathTracer::DrawLight(const Surface& surface, const Bsdf& bsdf, float pick,
                                             const Numbers& numbers, int bounce) const {
  Connection out;
  if (lights_.IsEmpty() || !bsdf.HasSmoothLobe()) return out;
  const LightSample sample = lights_.Sample(ReceiverAt(surface), pick, numbers.Get(bounce, kLightPoint));
  if (sample.pdf <= 0) return out;
  float bsdf_pdf = 0;
  out.value = bsdf.Evaluate(sample.direction, &bsdf_pdf);
  if (out.value.diffuse <= 0 && MaxComponent(out.value.specular) <= 0) return out;
  out.light = sample.radiance * LightSampleWeight(sample, bsdf_pdf);
  SetShadowRay(surface, sample, &out.ray);
  return out;
}

PathTracer::Connection PathTracer::ConnectToLight(const Surface& surface, const Bsdf& bsdf, float pick,
                                                  const Numbers& numbers, int bounce) const {
  Connection out = DrawLight(surface, bsdf, pick, numbers, bounce);
  if (!out.IsDark()) out.light *= visibility_.Transmittance(out.ray);
  return out;
}

void PathTracer::Shadow(FirstSurfaces* surfaces) const {
  std::array<Connection*, kPacket> lit;
  std::array<Ray, kPacket> rays;
  size_t count = 0;
  for (std::optional<FirstSurface>& first : *surfaces) {
    if (!first.has_value() || first->connection.IsDark()) continue;
    rays[count] = first->connection.ray;
    lit[count++] = &first->connection;
  }
  if (count == 0) return;
  std::array<Vec3, kPacket> through;
  visibility_.Transmittances({rays.data(), count}, through);
  for (size_t i = 0; i < count; ++i) lit[i]->light *= through[i];
}

Vec3 PathTracer::EmittedOnHit(const LightReceiver& from, const Surface& surface, const Hit& hit,
                              Vec3 direction, float pdf) const {
  const Vec3 emitted = surfaces_.Emitted(surface);
  if (pdf <= 0) return emitted;  // no light sample could have made this connection
  const float cos_light = std::abs(Dot(direction, surface.geometric));
  const float distance = Length(surface.position - from.position);  // clear panes may lie between
  const float light_pdf = lights_.DensityOfHit(from, hit.instance, hit.triangle, distance, cos_light);
  if (light_pdf <= 0) return emitted;
  return emitted * HitWeight(pdf, light_pdf);
}

Vec3 PathTracer::EmittedOnMiss(Vec3 direction, float pdf) const {
  if (!lights_.HasEnvironment()) return {0, 0, 0};
  const Vec3 radiance = lights_.SkyRadiance(direction);
  const float light_pdf = pdf > 0 ? lights_.SkyDensity(direction) : 0.0f;
  if (light_pdf <= 0) return radiance;
  return radiance * HitWeight(pdf, light_pdf);
}

PathTracer::Tail PathTracer::TraceTail(Departure* next, int bounce, Vec3 visible, const Numbers& numbers,
                                       Indirect indirect) const {
  Tail tail;
  Vec3* arrival = &tail.one_step;
  Vec3 throughput = {1, 1, 1};
  int scatterings = bounce;  // clear panes apart
  for (;; ++bounce) {
    const Hit hit = embree_->Intersect(next->ray);
    if (hit.IsMiss()) {
      *arrival += throughput * EmittedOnMiss(next->ray.direction, next->pdf);
      if (arrival == &tail.one_step) tail.first_step = std::numeric_limits<float>::infinity();
      return tail;
    }
    if (arrival == &tail.one_step) tail.first_step += hit.distance;
    const Surface surface = surfaces_.Read(hit, next->ray);
    if (!surface.front && surface.material->has_volume)
      throughput *= Attenuation(*surface.material, hit.distance);
    if (surface.radiates)
      *arrival += throughput * EmittedOnHit(next->from, surface, hit, next->ray.direction, next->pdf);
    if (scatterings > max_bounces_) return tail;

    const Bsdf bsdf = MakeBsdf(surface, -next->ray.direction);
    const Vec2 light_and_lobe = numbers.Get(bounce, kLightAndLobe);
    if (indirect == Indirect::kTraced) {
      const Connection connection = ConnectToLight(surface, bsdf, light_and_lobe.x, numbers, bounce);
      tail.longer += throughput * TotalOf(connection.value, bsdf.DiffuseAlbedo()) * connection.light;
    }

    float lobe = light_and_lobe.y;
    if (bounce >= kFirstRouletteBounce) {
      const float survive = Survive(visible * throughput * bsdf.Albedo(), &lobe);
      if (survive <= 0) return tail;
      throughput *= 1.0f / survive;
    }
    const BsdfSample step = bsdf.Sample(lobe, numbers.Get(bounce, kDirection));
    if (!step.valid) return tail;
    throughput *= TotalOf(step.weight, bsdf.DiffuseAlbedo());
    const uint64_t chance = numbers.Chance(bounce);
    if (step.straight) {
      surface.Leave(step, chance, &next->ray);
      continue;
    }
    if (indirect == Indirect::kLeftOut) return tail;
    next->Set(surface, step, chance);
    arrival = &tail.longer;
    ++scatterings;
  }
}

PathTracer::Scattering PathTracer::Scatter(const Surface& surface, const Bsdf& bsdf,
                                           const Connection& connection, float lobe, int bounce, Vec3 visible,
                                           const Numbers& numbers, Indirect indirect) const {
  Scattering out;
  const Vec3 albedo = bsdf.DiffuseAlbedo();
  out.direct = connection.light * connection.value.diffuse;
  out.specular = connection.light * connection.value.specular;
  out.total = connection.light * TotalOf(connection.value, albedo);

  const float survive = bounce >= kFirstRouletteBounce ? Survive(visible * bsdf.Albedo(), &lobe) : 1.0f;
  if (survive <= 0) return out;
  BsdfSample step = bsdf.Sample(lobe, numbers.Get(bounce, kDirection));
  if (survive < 1) {
    step.weight.diffuse /= survive;
    step.weight.specular = step.weight.specular / survive;
  }
  if (step.specular_event) out.event = step;
  if (step.specular_event || !step.valid) return out;
  const Vec3 weight = TotalOf(step.weight, albedo);
  Departure next(surface, step, numbers.Chance(bounce));
  const bool brings_more = indirect == Indirect::kTraced || MaxComponent(step.weight.specular) > 0;
  const Tail tail = TraceTail(&next, bounce + 1, visible * weight, numbers,
                              brings_more ? Indirect::kTraced : Indirect::kLeftOut);
  out.direct += tail.one_step * step.weight.diffuse;
  out.indirect = tail.longer * step.weight.diffuse;
  out.specular += (tail.one_step + tail.longer) * step.weight.specular;
  out.total += (tail.one_step + tail.longer) * weight;
  return out;
}

void PathTracer::FollowChain(const Surface& first, const BsdfSample& event, Vec3 throughput,
                             const Numbers& numbers, LayerSample* out) const {
  const layers::Branch branch =
      event.transmitted ? layers::Branch::kTransmission : layers::Branch::kReflection;
  Departure next(first, event, numbers.Chance(0));
  for (int depth = 1; depth <= layers::kMaxDepth; ++depth) {
    LevelSample& level = out->levels.Set({branch, depth});
    const Hit hit = embree_->Intersect(next.ray);
    if (hit.IsMiss()) {
      level.emitted = throughput * EmittedOnMiss(next.ray.direction, 0);
      out->combined += level.emitted;
      return;
    }
    const Surface surface = surfaces_.Read(hit, next.ray);
    if (!surface.front && surface.material->has_volume)
      throughput *= Attenuation(*surface.material, hit.distance);
    level.emitted = throughput * surfaces_.Emitted(surface);
    out->combined += level.emitted;
    if (depth > max_bounces_) return;

    const Bsdf bsdf = MakeBsdf(surface, -next.ray.direction);
    const Vec2 light_and_lobe = numbers.Get(depth, kLightAndLobe);
    const Connection connection = ConnectToLight(surface, bsdf, light_and_lobe.x, numbers, depth);
    const Scattering light = Scatter(surface, bsdf, connection, light_and_lobe.y, depth, throughput, numbers);
    level.has_diffuse = bsdf.HasDiffuse();
    level.albedo = throughput * bsdf.DiffuseAlbedo();
    level.direct = light.direct;
    level.indirect = light.indirect;
    out->tail += throughput * light.specular;
    out->combined += throughput * light.total;
    if (!light.event.valid) return;
    throughput *= light.event.weight.specular;
    next.Set(surface, light.event, numbers.Chance(depth));
  }
  const Tail rest = TraceTail(&next, layers::kMaxDepth + 1, throughput, numbers);
  const Vec3 radiance = throughput * (rest.one_step + rest.longer);
  out->tail += radiance;
  out->combined += radiance;
}

PathTracer::FirstSurfaces PathTracer::Meet(std::span<const Ray> rays,
                                           std::span<const Sampler> samplers) const {
  std::array<Hit, kPacket> hits;
  embree_->IntersectTogether(rays, hits);
  FirstSurfaces surfaces;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!hits[i].IsMiss()) surfaces[i].emplace(*this, hits[i], rays[i], Numbers(samplers[i]));
  }
  Shadow(&surfaces);
  return surfaces;
}

void PathTracer::TraceFrom(const FirstSurface& first, const Sampler& sampler, Indirect indirect,
                           LayerSample* out) const {
  const Surface& surface = first.surface;
  const Bsdf& bsdf = first.bsdf;
  const Numbers numbers(sampler);
  const Scattering light =
      Scatter(surface, bsdf, first.connection, first.lobe, 0, {1, 1, 1}, numbers, indirect);
  out->emitted = surfaces_.Emitted(surface);
  out->albedo = bsdf.DiffuseAlbedo();
  out->direct = light.direct;
  out->indirect = light.indirect;
  Demodulate(light.specular, bsdf.SpecularAlbedo(), out);
  out->combined = out->emitted + light.total;
  if (!light.event.specular_event) return;
  if (!bsdf.IsSmoothGlass()) {
    if (light.event.valid) FollowChain(surface, light.event, light.event.weight.specular, numbers, out);
    return;
  }
  // Light through glass and light on it are both there in every sample, each with its own random numbers.
  const float share = 1.0f / bsdf.PerfectProbability();
  const BsdfSample reflected = bsdf.PerfectReflection();
  const BsdfSample transmitted = bsdf.PerfectTransmission();
  if (reflected.valid) FollowChain(surface, reflected, reflected.weight.specular * share, numbers, out);
  if (transmitted.valid) {
    FollowChain(surface, transmitted, transmitted.weight.specular * share,
                Numbers(sampler, kTransmissionPairs), out);
  }
}

void PathTracer::TraceMiss(const Ray& ray, LayerSample* out) const {
  out->emitted = EmittedOnMiss(ray.direction, 0);
  out->combined = out->emitted;
}

void PathTracer::Trace(std::span<const Ray> rays, std::span<const Sampler> samplers,
                       std::span<LayerSample> out) const {
  const FirstSurfaces surfaces = Meet(rays, samplers);
  for (size_t i = 0; i < rays.size(); ++i) {
    out[i].Clear();
    if (surfaces[i].has_value()) {
      TraceFrom(*surfaces[i], samplers[i], Indirect::kTraced, &out[i]);
    } else {
      TraceMiss(rays[i], &out[i]);
    }
  }
}

void PathTracer::TraceWithoutIndirect(std::span<const Ray> rays, std::span<const Sampler> samplers,
                                      std::span<LayerSample> out,
                                      std::span<std::optional<Surface>> diffuse) const {
  const FirstSurfaces surfaces = Meet(rays, samplers);
  for (size_t i = 0; i < rays.size(); ++i) {
    out[i].Clear();
    diffuse[i].reset();
    if (!surfaces[i].has_value()) {
      TraceMiss(rays[i], &out[i]);
      continue;
    }
    TraceFrom(*surfaces[i], samplers[i], Indirect::kLeftOut, &out[i]);
    // Of paths that were followed for their specular light.
    out[i].combined = out[i].combined - out[i].indirect * out[i].albedo;
    out[i].indirect = {};
    if (surfaces[i]->bsdf.HasDiffuse()) diffuse[i] = surfaces[i]->surface;
  }
}

std::optional<Surface> PathTracer::FirstDiffuseSurface(const Ray& ray) const {
  const Hit hit = embree_->Intersect(ray);
  if (hit.IsMiss()) return std::nullopt;
  const Surface surface = surfaces_.Read(hit, ray);
  if (!MakeBsdf(surface, -ray.direction).HasDiffuse()) return std::nullopt;
  return surface;
}

Arrival PathTracer::TraceArrival(const Surface& surface, Vec3 direction, const Sampler& sampler) const {
  const Numbers numbers(sampler);
  BsdfSample step;
  step.wi = direction;
  step.pdf = Dot(direction, surface.normal) / kPi;
  Departure next(surface, step, numbers.Chance(0));
  const Tail tail = TraceTail(&next, 1, {1, 1, 1}, numbers);
  return {tail.longer, tail.first_step};
}

Vec3 PathTracer::RadianceFrom(const FirstSurface& first, const Sampler& sampler) const {
  const Numbers numbers(sampler);
  const Scattering light =
      Scatter(first.surface, first.bsdf, first.connection, first.lobe, 0, {1, 1, 1}, numbers);
  const Vec3 radiance = surfaces_.Emitted(first.surface) + light.total;
  if (!light.event.valid) return radiance;
  const Vec3 weight = light.event.weight.specular;
  Departure next(first.surface, light.event, numbers.Chance(0));
  const Tail tail = TraceTail(&next, 1, weight, numbers);
  return radiance + weight * (tail.one_step + tail.longer);
}

void PathTracer::TraceRadiance(std::span<const Ray> rays, std::span<const Sampler> samplers,
                               std::span<Vec3> out) const {
  const FirstSurfaces surfaces = Meet(rays, samplers);
  for (size_t i = 0; i < rays.size(); ++i) {
    out[i] = surfaces[i].has_value() ? RadianceFrom(*surfaces[i], samplers[i])
                                     : EmittedOnMiss(rays[i].direction, 0);
  }
}

}  // namespace lumifold::render
