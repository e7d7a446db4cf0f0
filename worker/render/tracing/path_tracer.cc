#include "worker/render/tracing/path_tracer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "filter/image/portable_math.h"
#include "worker/render/materials/diffuse_bsdf.h"
#include "worker/render/materials/lobes.h"
#include "worker/render/tracing/path_state.h"

namespace lumifold::render {
namespace {

/// First dimension pair of the transmission branch: above all pairs that the reflection branch uses.
constexpr uint32_t kTransmissionPairs = 1u << 16;

/// Vertices of a recorded path: there may be a thousand bounces, and next to no light comes from beyond
/// these.
constexpr size_t kMaxRecordedVertices = 16;

/// Glossy radiance is not divided by a directional albedo below this.
constexpr float kMinGlossyAlbedo = 1e-6f;

/// The value of all lobes.
template <typename BsdfType>
Vec3 TotalOf(const BsdfValue& value, const BsdfType& bsdf) {
  const Vec3 diffuse = bsdf.DiffuseAlbedo() * value.diffuse;
  if constexpr (BsdfType::kDiffuseOnly) {
    return diffuse;
  } else {
    return diffuse + value.non_diffuse;
  }
}

/// Builds the shadow ray from `surface` to the light sample; `ray` must be new.
void SetShadowRay(const Surface& surface, const LightSample& sample, Ray* ray) {
  ray->origin = surface.Offset(sample.direction);
  ray->direction = sample.direction;
  if (std::isinf(sample.distance)) return;
  constexpr float kBeforeLight = 1.0f - 0x1p-12f;  // the light must not occlude itself
  // Towards the sampled point itself: a ray parallel to sample.direction, but from the offset origin, hits a
  // light at a grazing angle far from that point.
  const Vec3 segment = surface.position + sample.direction * sample.distance - ray->origin;
  const float length = Length(segment);
  ray->direction = segment * (1.0f / length);
  ray->max_distance = length * kBeforeLight;
}

/// Transmittance of `distance` metres inside a volume, by Beer's law.
Vec3 VolumeTransmittance(const scene::Material& material, float distance) {
  if (material.volume.attenuation_distance <= 0) return {1, 1, 1};
  const float lengths = distance / material.volume.attenuation_distance;
  const Vec3 c = material.volume.attenuation_color;
  return {Pow(c.x, lengths), Pow(c.y, lengths), Pow(c.z, lengths)};
}

/// Attenuates `throughput` by the volume that the ray to `surface` has crossed.
void Attenuate(const Surface& surface, const Hit& hit, Vec3* throughput) {
  if (!surface.front && surface.material->volume.is_solid)
    *throughput *= VolumeTransmittance(*surface.material, hit.distance);
}

/// Decides by *u whether a path goes on that does so with probability `survival`. If it does, *u is rescaled
/// to a random number in [0, 1).
bool Survives(float survival, float* u) {
  if (survival >= 1) return true;
  if (*u >= survival) return false;
  *u = std::min(*u / survival, 0x1.fffffep-1f);
  return true;
}

/// Stores glossy radiance as G and S. Channels whose S is too small go to the remainder.
void Demodulate(Vec3 radiance, Vec3 albedo, LayerSample* out) {
  const auto over = [](float value, float by) { return by > kMinGlossyAlbedo ? value / by : 0.0f; };
  const auto rest = [](float value, float by) { return by > kMinGlossyAlbedo ? 0.0f : value; };
  out->glossy_albedo = albedo;
  out->glossy = {over(radiance.x, albedo.x), over(radiance.y, albedo.y), over(radiance.z, albedo.z)};
  out->remainder = {rest(radiance.x, albedo.x), rest(radiance.y, albedo.y), rest(radiance.z, albedo.z)};
}

layers::Branch BranchOf(const BsdfSample& event) {
  return event.transmitted ? layers::Branch::kTransmission : layers::Branch::kReflection;
}

}  // namespace

PathTracer::PathTracer(const scene::Scene& scene, const EmbreeScene& embree,
                       std::shared_ptr<const Environment> environment, int max_bounces, const MipSource& mips,
                       const TracingPlan& plan)
    : embree_(&embree),
      textures_(scene, mips),
      surfaces_(scene, textures_),
      lights_(scene, textures_, std::move(environment)),
      diffuse_only_(plan.diffuse_code && IsDiffuseOnly(scene)),
      albedo_table_(diffuse_only_ ? AlbedoTable::Contents{.reflection = false} : AlbedoContentsOf(scene)),
      visibility_(scene, embree, surfaces_, albedo_table_),
      max_bounces_(max_bounces),
      plan_(plan) {}

template <typename BsdfType>
BsdfType PathTracer::MakeBsdf(const Surface& surface, Vec3 wo) const {
  if (surface.values != nullptr)
    return {*surface.values, albedo_table_, surface.normal, surface.geometric, wo};
  return {surfaces_.Shade(surface), albedo_table_, surface.normal, surface.geometric, wo};
}

float PathTracer::HitWeight(float bsdf_pdf, float light_pdf) const {
  if (strategy_ == LightStrategy::kCombined) return bsdf_pdf / (bsdf_pdf + light_pdf);
  return strategy_ == LightStrategy::kBsdfHits ? 1.0f : 0.0f;
}

float PathTracer::LightSampleWeight(const LightSample& sample, float bsdf_pdf) const {
  if (sample.is_delta || strategy_ == LightStrategy::kLightSamples) return 1.0f / sample.pdf;
  return strategy_ == LightStrategy::kCombined ? 1.0f / (sample.pdf + bsdf_pdf) : 0.0f;
}

template <typename BsdfType>
PathTracer::Connection PathTracer::SampleLight(const Surface& surface, const BsdfType& bsdf, float u_light,
                                               const PathSampler& random, int vertex) const {
  Connection out;
  if (lights_.IsEmpty() || !bsdf.HasNonDeltaLobe()) return out;
  const LightSample sample =
      lights_.Sample(ReceiverAt(surface), u_light, random.Get2D(vertex, PathSampler::kLightPoint));
  if (sample.pdf <= 0) return out;
  float bsdf_pdf = 0;
  out.value = bsdf.Evaluate(sample.direction, &bsdf_pdf);
  if (out.value.diffuse <= 0 && (BsdfType::kDiffuseOnly || MaxComponent(out.value.non_diffuse) <= 0))
    return out;
  out.light = sample.radiance * LightSampleWeight(sample, bsdf_pdf);
  SetShadowRay(surface, sample, &out.ray);
  return out;
}

template <typename BsdfType>
PathTracer::Connection PathTracer::ConnectToLight(const Surface& surface, const BsdfType& bsdf, float u_light,
                                                  const PathSampler& random, int vertex) const {
  Connection out = SampleLight(surface, bsdf, u_light, random, vertex);
  if (!out.IsBlack()) out.light *= visibility_.Transmittance(out.ray);
  return out;
}

template <typename BsdfType>
void PathTracer::ApplyVisibility(FirstSurfaces<BsdfType>* surfaces) const {
  std::array<Connection*, kPacket> connections;
  std::array<Ray, kPacket> rays;
  size_t count = 0;
  for (std::optional<FirstSurface<BsdfType>>& first : *surfaces) {
    if (!first.has_value() || first->connection.IsBlack()) continue;
    rays[count] = first->connection.ray;
    connections[count++] = &first->connection;
  }
  if (count == 0) return;
  std::array<Vec3, kPacket> transmittances;
  visibility_.Transmittances({rays.data(), count}, transmittances);
  for (size_t i = 0; i < count; ++i) connections[i]->light *= transmittances[i];
}

Vec3 PathTracer::EmittedOnHit(const LightReceiver& from, const Surface& surface, const Hit& hit,
                              Vec3 direction, float pdf) const {
  const Vec3 emitted = surfaces_.Emitted(surface);
  if (pdf <= 0) return emitted;  // light sampling cannot generate this path
  const float cos_light = std::abs(Dot(direction, surface.geometric));
  const float distance = Length(surface.position - from.position);  // hit.distance starts at the last pane
  const float light_pdf = lights_.DensityOfHit(from, hit.instance, hit.triangle, distance, cos_light);
  if (light_pdf <= 0) return emitted;
  return emitted * HitWeight(pdf, light_pdf);
}

Vec3 PathTracer::EmittedOnMiss(Vec3 direction, float pdf) const {
  if (!lights_.HasEnvironment()) return {0, 0, 0};
  const Vec3 radiance = lights_.EnvironmentRadiance(direction);
  const float light_pdf = pdf > 0 ? lights_.EnvironmentDensity(direction) : 0.0f;
  if (light_pdf <= 0) return radiance;
  return radiance * HitWeight(pdf, light_pdf);
}

template <typename BsdfType>
PathTracer::IncidentRadiance PathTracer::TraceIncident(PathSegment* segment, int vertex, Vec3 path_throughput,
                                                       const PathSampler& random, Indirect indirect,
                                                       std::vector<PathVertex>* record) const {
  IncidentRadiance incident;
  Vec3* emission = &incident.direct;  // where emission at the next hit is added
  Vec3 throughput = {1, 1, 1};
  int scatterings = vertex;  // clear panes do not count
  for (;; ++vertex) {
    const Hit hit = embree_->Intersect(segment->ray);
    const bool is_first = emission == &incident.direct;
    if (hit.IsMiss()) {
      *emission += throughput * EmittedOnMiss(segment->ray.direction, segment->pdf);
      if (is_first) incident.first_distance = std::numeric_limits<float>::infinity();
      return incident;
    }
    if (is_first) incident.first_distance += hit.distance;
    const Surface surface = surfaces_.Read(hit, segment->ray);
    Attenuate(surface, hit, &throughput);
    if (surface.is_emissive) {
      *emission +=
          throughput * EmittedOnHit(segment->from, surface, hit, segment->ray.direction, segment->pdf);
    }
    if (scatterings > max_bounces_) return incident;

    const auto bsdf = MakeBsdf<BsdfType>(surface, -segment->ray.direction);
    const Vec2 light_and_lobe = random.Get2D(vertex, PathSampler::kLightAndLobe);
    if (indirect == Indirect::kTraced) {
      const Connection connection = ConnectToLight(surface, bsdf, light_and_lobe.x, random, vertex);
      incident.indirect += throughput * TotalOf(connection.value, bsdf) * connection.light;
    }

    float u_lobe = light_and_lobe.y;
    const float next_throughput = MaxComponent(path_throughput * throughput * bsdf.Albedo());
    if (record != nullptr) {
      if (record->size() == kMaxRecordedVertices) return incident;
      record->push_back({path_throughput * incident.indirect, next_throughput, RaysOfThread()});
    } else {
      const float survival = plan_.roulette.Survival(vertex, next_throughput);
      if (!Survives(survival, &u_lobe)) return incident;
      throughput *= 1.0f / survival;
    }
    const BsdfSample step = bsdf.Sample(u_lobe, random.Get2D(vertex, PathSampler::kDirection));
    if (!step.valid) return incident;
    throughput *= TotalOf(step.weight, bsdf);
    if (!BsdfType::kDiffuseOnly && step.straight) {
      surface.SpawnRay(step, random.Key(vertex), &segment->ray);
      continue;
    }
    if (indirect == Indirect::kLeftOut || (!plan_.emission_on_hits && scatterings >= max_bounces_))
      return incident;
    segment->Set(surface, step, random.Key(vertex));
    emission = &incident.indirect;
    ++scatterings;
  }
}

template <typename BsdfType>
PathTracer::ScatteredRadiance PathTracer::Scatter(const Surface& surface, const BsdfType& bsdf,
                                                  const Connection& connection, float u_lobe, int vertex,
                                                  Vec3 path_throughput, const PathSampler& random,
                                                  Indirect indirect) const {
  ScatteredRadiance out;
  out.direct = connection.light * connection.value.diffuse;
  if constexpr (!BsdfType::kDiffuseOnly) out.glossy = connection.light * connection.value.non_diffuse;
  out.total = connection.light * TotalOf(connection.value, bsdf);

  // A surface seen in mirrors is like one that the camera sees: a plan's rule begins at the next one.
  const float survival = Roulette{}.Survival(vertex, MaxComponent(path_throughput * bsdf.Albedo()));
  if (!Survives(survival, &u_lobe)) return out;
  BsdfSample step = bsdf.Sample(u_lobe, random.Get2D(vertex, PathSampler::kDirection));
  if (survival < 1) {
    step.weight.diffuse /= survival;
    step.weight.non_diffuse = step.weight.non_diffuse / survival;
  }
  if constexpr (!BsdfType::kDiffuseOnly) {
    if (step.is_delta) out.delta_event = step;
  }
  if (step.is_delta || !step.valid) return out;
  if (!plan_.emission_on_hits && vertex >= max_bounces_) return out;
  const Vec3 weight = TotalOf(step.weight, bsdf);
  PathSegment next(surface, step, random.Key(vertex));
  const bool has_glossy = MaxComponent(step.weight.non_diffuse) > 0;
  const auto incident = TraceIncident<BsdfType>(&next, vertex + 1, path_throughput * weight, random,
                                                has_glossy ? Indirect::kTraced : indirect);
  out.direct += incident.direct * step.weight.diffuse;
  out.indirect = incident.indirect * step.weight.diffuse;
  if constexpr (!BsdfType::kDiffuseOnly)
    out.glossy += (incident.direct + incident.indirect) * step.weight.non_diffuse;
  out.total += (incident.direct + incident.indirect) * weight;
  return out;
}

void PathTracer::TraceDeltaChain(const Surface& first, const BsdfSample& event, Vec3 throughput,
                                 const PathSampler& random, LayerSample* out) const {
  const layers::Branch branch = BranchOf(event);
  PathSegment next(first, event, random.Key(0));
  for (int depth = 1; depth <= plan_.levels; ++depth) {
    LevelSample& level = out->levels.Set({branch, depth});
    const Hit hit = embree_->Intersect(next.ray);
    if (hit.IsMiss()) {
      level.emitted = throughput * EmittedOnMiss(next.ray.direction, 0);
      out->combined += level.emitted;
      return;
    }
    const Surface surface = surfaces_.Read(hit, next.ray);
    Attenuate(surface, hit, &throughput);
    level.emitted = throughput * surfaces_.Emitted(surface);
    out->combined += level.emitted;
    if (depth > max_bounces_) return;

    const Bsdf bsdf = MakeBsdf(surface, -next.ray.direction);
    const Vec2 light_and_lobe = random.Get2D(depth, PathSampler::kLightAndLobe);
    const Connection connection = ConnectToLight(surface, bsdf, light_and_lobe.x, random, depth);
    const ScatteredRadiance scattered =
        Scatter(surface, bsdf, connection, light_and_lobe.y, depth, throughput, random);
    level.has_diffuse = bsdf.HasDiffuse();
    level.albedo = throughput * bsdf.DiffuseAlbedo();
    level.direct = scattered.direct;
    level.indirect = scattered.indirect;
    out->remainder += throughput * scattered.glossy;
    out->combined += throughput * scattered.total;
    if (!scattered.delta_event.valid) return;
    throughput *= scattered.delta_event.weight.non_diffuse;
    next.Set(surface, scattered.delta_event, random.Key(depth));
  }
  const auto incident = TraceIncident<Bsdf>(&next, plan_.levels + 1, throughput, random);
  const Vec3 radiance = throughput * (incident.direct + incident.indirect);
  out->remainder += radiance;
  out->combined += radiance;
}

template <typename BsdfType>
PathTracer::FirstSurfaces<BsdfType> PathTracer::IntersectFirst(std::span<const Ray> rays,
                                                               std::span<const Sampler> samplers) const {
  std::array<Hit, kPacket> hits;
  embree_->IntersectTogether(rays, hits);
  FirstSurfaces<BsdfType> surfaces;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!hits[i].IsMiss()) surfaces[i].emplace(*this, hits[i], rays[i], PathSampler(samplers[i]));
  }
  ApplyVisibility(&surfaces);
  return surfaces;
}

template <typename BsdfType>
void PathTracer::TraceLayers(const FirstSurface<BsdfType>& first, const Sampler& sampler, Indirect indirect,
                             LayerSample* out) const {
  const Surface& surface = first.surface;
  const BsdfType& bsdf = first.bsdf;
  const PathSampler random(sampler);
  const ScatteredRadiance scattered =
      Scatter(surface, bsdf, first.connection, first.u_lobe, 0, {1, 1, 1}, random, indirect);
  out->first = {first.instance, surface.normal, first.distance, 1};
  out->emitted = surfaces_.Emitted(surface);
  out->albedo = bsdf.DiffuseAlbedo();
  out->direct = scattered.direct;
  out->indirect = scattered.indirect;
  out->combined = out->emitted + scattered.total;
  if constexpr (!BsdfType::kDiffuseOnly) {
    out->first.roughness = bsdf.ReflectionAlpha();
    Demodulate(scattered.glossy, bsdf.GlossyAlbedo(), out);
    const BsdfSample& event = scattered.delta_event;
    if (!event.is_delta) return;
    if (bsdf.IsSmoothGlass()) {
      TraceBothBranches(first, sampler, out);
    } else if (event.valid) {
      TraceDeltaChain(surface, event, event.weight.non_diffuse, random, out);
    }
  }
}

void PathTracer::TraceBothBranches(const FirstSurface<Bsdf>& first, const Sampler& sampler,
                                   LayerSample* out) const {
  const float inverse_probability = 1.0f / first.bsdf.DeltaProbability();
  const BsdfSample reflected = first.bsdf.DeltaReflection();
  const BsdfSample transmitted = first.bsdf.DeltaTransmission();
  if (reflected.valid) {
    TraceDeltaChain(first.surface, reflected, reflected.weight.non_diffuse * inverse_probability,
                    PathSampler(sampler), out);
  }
  if (transmitted.valid) {
    TraceDeltaChain(first.surface, transmitted, transmitted.weight.non_diffuse * inverse_probability,
                    PathSampler(sampler, kTransmissionPairs), out);
  }
}

void PathTracer::TraceMiss(const Ray& ray, LayerSample* out) const {
  out->emitted = EmittedOnMiss(ray.direction, 0);
  out->combined = out->emitted;
}

template <typename BsdfType>
void PathTracer::TraceWith(std::span<const Ray> rays, std::span<const Sampler> samplers,
                           std::span<LayerSample> out) const {
  const auto surfaces = IntersectFirst<BsdfType>(rays, samplers);
  for (size_t i = 0; i < rays.size(); ++i) {
    out[i].Clear();
    if (surfaces[i].has_value()) {
      TraceLayers(*surfaces[i], samplers[i], Indirect::kTraced, &out[i]);
    } else {
      TraceMiss(rays[i], &out[i]);
    }
  }
}

void PathTracer::Trace(std::span<const Ray> rays, std::span<const Sampler> samplers,
                       std::span<LayerSample> out) const {
  if (diffuse_only_) {
    TraceWith<DiffuseBsdf>(rays, samplers, out);
  } else {
    TraceWith<Bsdf>(rays, samplers, out);
  }
}

template <typename BsdfType>
void PathTracer::RecordWith(const Ray& ray, const Sampler& sampler, std::vector<PathVertex>* out) const {
  const auto surfaces = IntersectFirst<BsdfType>({&ray, 1}, {&sampler, 1});
  if (!surfaces[0].has_value()) return;
  const Surface& surface = surfaces[0]->surface;
  const BsdfType& bsdf = surfaces[0]->bsdf;
  const PathSampler random(sampler);
  const BsdfSample step = bsdf.Sample(surfaces[0]->u_lobe, random.Get2D(0, PathSampler::kDirection));
  if (!step.valid || step.is_delta) return;
  const Vec3 weight = TotalOf(step.weight, bsdf);
  PathSegment next(surface, step, random.Key(0));
  const int64_t rays_before = RaysOfThread();
  const auto incident = TraceIncident<BsdfType>(&next, 1, weight, random, Indirect::kTraced, out);
  out->push_back({weight * incident.indirect, 0, RaysOfThread()});
  for (PathVertex& vertex : *out) vertex.rays -= rays_before;
}

void PathTracer::RecordIndirect(const Ray& ray, const Sampler& sampler, std::vector<PathVertex>* out) const {
  out->clear();
  if (max_bounces_ == 0) return;
  if (diffuse_only_) {
    RecordWith<DiffuseBsdf>(ray, sampler, out);
  } else {
    RecordWith<Bsdf>(ray, sampler, out);
  }
}

// ChartsAccess uses these.
template PathTracer::FirstSurfaces<Bsdf> PathTracer::IntersectFirst<Bsdf>(std::span<const Ray>,
                                                                          std::span<const Sampler>) const;
template void PathTracer::TraceLayers<Bsdf>(const FirstSurface<Bsdf>&, const Sampler&, Indirect,
                                            LayerSample*) const;
template PathTracer::ScatteredRadiance PathTracer::Scatter<Bsdf>(const Surface&, const Bsdf&,
                                                                 const Connection&, float, int, Vec3,
                                                                 const PathSampler&, Indirect) const;
template PathTracer::IncidentRadiance PathTracer::TraceIncident<Bsdf>(PathSegment*, int, Vec3,
                                                                      const PathSampler&, Indirect,
                                                                      std::vector<PathVertex>*) const;
template Bsdf PathTracer::MakeBsdf<Bsdf>(const Surface&, Vec3) const;

}  // namespace lumifold::render
