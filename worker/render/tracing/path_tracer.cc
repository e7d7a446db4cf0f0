#include "worker/render/tracing/path_tracer.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"
#include "worker/render/lanes/pick_lanes.h"
#include "worker/render/materials/dispersion.h"
#include "worker/render/materials/lobes.h"
#include "worker/render/sampling/roulette.h"
#include "worker/render/tracing/path_stream.h"

namespace lumifold::render {
namespace {

/// The value of all lobes.
Vec3 TotalOf(const BsdfValue& value, Vec3 diffuse_albedo) {
  return diffuse_albedo * value.diffuse + value.non_diffuse;
}

/// Sets what a connection's light is multiplied with.
void SetFactor(Vec3 diffuse_albedo, const Path& path, Connection* connection) {
  const bool is_seen = path.part == PathPart::kSeen;
  const Vec3 total = TotalOf(connection->value, diffuse_albedo);
  connection->factor = is_seen ? total : path.throughput * total;
  connection->is_seen = is_seen ? 1.0f : 0.0f;
}

/// What layers need of a surface that is seen.
struct SeenLobes {
  Vec3 diffuse_albedo;
  Vec3 glossy_albedo;
  bool has_diffuse;
  float roughness;
};

void OpenSeen(const Hit& hit, const Surface& surface, const SeenLobes& lobes, Path* path) {
  path->seen.is_open = true;
  path->seen.depth = path->vertex;
  path->seen.direct = path->seen.glossy = path->seen.total = {};
  if (path->vertex > 0) {
    LevelSample& level = path->out->levels.Set({path->branch, path->vertex});
    level.has_diffuse = lobes.has_diffuse;
    level.albedo = path->seen.throughput * lobes.diffuse_albedo;
    return;
  }
  path->out->first = {hit.instance, surface.normal, hit.distance, lobes.roughness};
  path->out->albedo = path->seen.throughput * lobes.diffuse_albedo;
  path->out->glossy_albedo = path->seen.throughput * lobes.glossy_albedo;
}

/// Builds the shadow ray from `surface` to the light sample.
void SetShadowRay(const Surface& surface, const LightSample& sample, float time, Ray* ray) {
  ray->time = time;
  ray->origin = surface.Offset(sample.direction);
  ray->direction = sample.direction;
  ray->max_distance = std::numeric_limits<float>::infinity();
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

}  // namespace

PathTracer::PathTracer(const scene::Scene& scene, const EmbreeScene& embree,
                       std::shared_ptr<const Environment> environment, int max_bounces, const MipSource& mips,
                       const TracingPlan& plan, const Backdrop& backdrop)
    : embree_(&embree),
      textures_(scene, mips),
      surfaces_(scene, textures_),
      lights_(scene, textures_, std::move(environment)),
      albedo_table_(plan.diffuse_code && IsDiffuseOnly(scene) ? AlbedoTable::Contents{.reflection = false}
                                                              : AlbedoContentsOf(scene)),
      visibility_(scene, embree, surfaces_, albedo_table_),
      max_bounces_(max_bounces),
      plan_(plan),
      backdrop_(backdrop) {
  for (const SurfaceMaterial& material : surfaces_.uniform())
    uniform_.push_back({BaseMaterial(material, albedo_table_), material.IsBaseOnly()});
}

Bsdf PathTracer::MakeBsdf(const Surface& surface, Vec3 wo) const {
  if (surface.values != nullptr)
    return {*surface.values, albedo_table_, surface.normal, surface.geometric, wo};
  return {surfaces_.Shade(surface), albedo_table_, surface.normal, surface.geometric, wo};
}

Bsdf PathTracer::BsdfOnPath(const Surface& surface, const SurfaceMaterial& material, const Path& path) const {
  const Vec3 wo = -path.ray.direction;
  if (material.rare.dispersion <= 0) return {material, albedo_table_, surface.normal, surface.geometric, wo};
  const Wavelength wavelength = Wavelength::Sample(path.random.ForWavelength());
  SurfaceMaterial dispersed = material;
  dispersed.ior = DispersedIor(material.ior, material.rare.dispersion, wavelength.shift);
  if (!path.options.is_dispersed) dispersed.rare.refraction_weight = wavelength.weight;
  return {dispersed, albedo_table_, surface.normal, surface.geometric, wo};
}

float PathTracer::HitWeight(float bsdf_pdf, float light_pdf) const {
  if (strategy_ == LightStrategy::kCombined) return bsdf_pdf / (bsdf_pdf + light_pdf);
  return strategy_ == LightStrategy::kBsdfHits ? 1.0f : 0.0f;
}

float PathTracer::LightSampleWeight(const LightSample& sample, float bsdf_pdf) const {
  if (sample.is_delta || strategy_ == LightStrategy::kLightSamples) return 1.0f / sample.pdf;
  return strategy_ == LightStrategy::kCombined ? 1.0f / (sample.pdf + bsdf_pdf) : 0.0f;
}

void PathTracer::SampleLight(const Surface& surface, const Bsdf& bsdf, const VertexNumbers& random,
                             const Path& path, Connection* out) const {
  if (lights_.IsEmpty() || !bsdf.HasNonDeltaLobe()) return;
  const LightSample sample = lights_.Sample(surface.Receiver(), random.light_and_lobe.x, random.light_point);
  if (sample.pdf <= 0) return;
  float bsdf_pdf = 0;
  out->value = bsdf.Evaluate(sample.direction, &bsdf_pdf);
  if (out->value.diffuse <= 0 && MaxComponent(out->value.non_diffuse) <= 0) return;
  SetFactor(bsdf.DiffuseAlbedo(), path, out);
  out->light = sample.radiance * LightSampleWeight(sample, bsdf_pdf);
  SetShadowRay(surface, sample, path.ray.time, &out->shadow_ray);
}

Vec3 PathTracer::EmittedOnHit(const Surface& surface, const Hit& hit, const Path& path) const {
  const Vec3 emitted = surfaces_.Emitted(surface);
  if (path.pdf <= 0) return emitted;  // light sampling cannot generate this path
  const float cos_light = std::abs(Dot(path.ray.direction, surface.geometric));
  // hit.distance starts at the last pane
  const float distance = Length(surface.position - path.from.position);
  const float light_pdf = lights_.DensityOfHit(path.from, hit.instance, hit.triangle, distance, cos_light);
  if (light_pdf <= 0) return emitted;
  return emitted * HitWeight(path.pdf, light_pdf);
}

Vec3 PathTracer::EmittedOnMiss(Vec3 direction, float pdf) const {
  if (!lights_.HasEnvironment()) return {0, 0, 0};
  const Vec3 radiance = lights_.EnvironmentRadiance(direction);
  const float light_pdf = pdf > 0 ? lights_.EnvironmentDensity(direction) : 0.0f;
  if (light_pdf <= 0) return radiance;
  return radiance * HitWeight(pdf, light_pdf);
}

void PathTracer::CatchShadows(std::span<const Ray> rays, std::span<const Sampler> samplers,
                              std::span<LayerSample> samples) const {
  for (size_t i = 0; i < rays.size(); ++i) {
    if (samples[i].first.instance != scene::kNone) continue;
    if (const std::optional<Surface> catcher = backdrop_.catchers->At(rays[i]); catcher.has_value())
      samples[i].caught = ShadowOn(*catcher, samplers[i], rays[i].time);
  }
}

CaughtShadow PathTracer::ShadowOn(const Surface& catcher, const Sampler& sampler, float time) const {
  CaughtShadow caught = {.is_hit = true};
  if (lights_.IsEmpty()) return caught;
  const VertexNumbers random = PathSampler(sampler).Draw(0);
  const LightSample sample = lights_.Sample({catcher.position, catcher.normal, /*transmits=*/false},
                                            random.light_and_lobe.x, random.light_point);
  const float cosine = Dot(sample.direction, catcher.normal);
  if (sample.pdf <= 0 || cosine <= 0) return caught;
  Ray ray;
  SetShadowRay(catcher, sample, time, &ray);
  const Vec3 unseen = sample.radiance * (Vec3{1, 1, 1} - visibility_.Transmittance(ray));
  const float light =
      Luminance(sample.radiance.x, sample.radiance.y, sample.radiance.z) * cosine / sample.pdf;
  const float shadow = Luminance(unseen.x, unseen.y, unseen.z) * cosine / sample.pdf;
  if (!std::isfinite(light) || !std::isfinite(shadow)) return caught;
  caught.light = light;
  caught.shadow = shadow;
  return caught;
}

bool PathTracer::Reach(const Hit& hit, Path* path, Surface* surface) const {
  if (path->part != PathPart::kLit) path->CloseSeen();
  if (path->part == PathPart::kSeen && path->vertex > 0) path->out->levels.Set({path->branch, path->vertex});
  if (hit.IsMiss()) {
    if (!path->incident.has_scattered) path->incident.first_distance = std::numeric_limits<float>::infinity();
    if (path->vertex > 0 || !backdrop_.is_transparent)
      path->AddEmission(EmittedOnMiss(path->ray.direction, path->pdf));
    return false;
  }
  if (!path->incident.has_scattered) path->incident.first_distance += hit.distance;
  surfaces_.Read(hit, path->ray, surface);
  if (path->vertex > 0)
    Attenuate(*surface, hit, &path->throughput);
  else if (!around_camera_.empty())
    path->throughput *= FirstTransmittance(*surface, hit);
  if (surface->is_emissive) path->AddEmission(EmittedOnHit(*surface, hit, *path));
  if (path->part == PathPart::kSeen) path->seen.throughput = path->throughput;
  return path->scatterings <= max_bounces_;
}

Vec3 PathTracer::FirstTransmittance(const Surface& surface, const Hit& hit) const {
  Vec3 left = {1, 1, 1};
  if (std::find(around_camera_.begin(), around_camera_.end(), surface.material) != around_camera_.end())
    Attenuate(surface, hit, &left);
  return left;
}

std::vector<const scene::Material*> PathTracer::SolidsAround(Vec3 point) const {
  constexpr Vec3 kDirections[] = {
      {1, 0.31f, 0.17f}, {-0.23f, 1, 0.41f}, {-0.37f, -0.29f, 1}, {-0.53f, -1, -0.71f}};
  constexpr int kMostCrossings = 64;
  std::map<const scene::Material*, size_t> around;  // by how many of the rays
  for (const Vec3 direction : kDirections) {
    std::map<const scene::Material*, int> left;
    Ray ray = {{.origin = point, .direction = Normalize(direction)}};
    for (int i = 0; i < kMostCrossings; ++i) {
      const Hit hit = embree_->Intersect(ray);
      if (hit.IsMiss()) break;
      const Surface surface = surfaces_.Read(hit, ray);
      if (surface.material->volume.is_solid && surface.material->volume.attenuation_distance > 0)
        left[surface.material] += surface.front ? -1 : 1;
      ray.origin = surface.Offset(ray.direction);
    }
    for (const auto& [material, times] : left) around[material] += times == 1 ? 1 : 0;
  }
  std::vector<const scene::Material*> solids;
  for (const auto& [material, rays] : around) {
    if (rays == std::size(kDirections)) solids.push_back(material);
  }
  return solids;
}

bool PathTracer::Scatter(const Hit& hit, const Surface& surface, const SurfaceMaterial& material,
                         const VertexNumbers& random, Path* path, Connection* connection,
                         std::vector<Path>* branches) const {
  const Bsdf bsdf = BsdfOnPath(surface, material, *path);
  const bool is_seen = path->part == PathPart::kSeen;
  if (is_seen) {
    OpenSeen(hit, surface,
             {bsdf.DiffuseAlbedo(), bsdf.GlossyAlbedo(), bsdf.HasDiffuse(), bsdf.ReflectionAlpha()}, path);
  }
  if (is_seen || !path->options.is_direct_only) SampleLight(surface, bsdf, random, *path, connection);

  float u_lobe = random.light_and_lobe.y;
  const float survival =
      SurvivalProbability(path->vertex, MaxComponent(path->before * path->throughput * bsdf.Albedo()));
  if (!Survives(survival, &u_lobe)) return false;
  const BsdfSample step = bsdf.Sample(u_lobe, random.direction);
  if (is_seen && step.is_delta && path->vertex == 0 && !path->options.is_single && bsdf.IsSmoothGlass())
    return TakeBothBranches(surface, bsdf, path, branches);
  return TakeStep(surface, bsdf.DiffuseAlbedo(), step, survival, path);
}

bool PathTracer::TakeStep(const Surface& surface, Vec3 diffuse_albedo, const BsdfSample& step, float survival,
                          Path* path) const {
  if (!step.valid) return false;
  if (path->part == PathPart::kSeen) return TakeSeenStep(surface, diffuse_albedo, step, survival, path);
  path->throughput *= 1.0f / survival;
  path->throughput *= TotalOf(step.weight, diffuse_albedo);
  if (step.straight) {
    path->Pass(surface, step);
    return true;
  }
  if (EndsHere(*path)) return false;
  path->Leave(surface, step);
  path->incident.has_scattered = true;
  return true;
}

bool PathTracer::EndsHere(const Path& path) const {
  if (path.part == PathPart::kSeen) return !plan_.emission_on_hits && path.vertex >= max_bounces_;
  return path.options.is_direct_only || (!plan_.emission_on_hits && path.scatterings >= max_bounces_);
}

bool PathTracer::TakeSeenStep(const Surface& surface, Vec3 diffuse_albedo, BsdfSample step, float survival,
                              Path* path) const {
  if (survival < 1) {
    step.weight.diffuse /= survival;
    step.weight.non_diffuse = step.weight.non_diffuse / survival;
  }
  if (step.is_delta) {
    path->LeaveByDelta(surface, step);
    return true;
  }
  if (EndsHere(*path)) return false;
  path->seen.weight = step.weight;
  path->seen.total_weight = TotalOf(step.weight, diffuse_albedo);
  path->options.is_direct_only = path->options.is_direct_only && MaxComponent(step.weight.non_diffuse) <= 0;
  path->Begin(PathPart::kLit,
              path->vertex == 0 ? path->throughput : path->throughput * path->seen.total_weight);
  path->Leave(surface, step);
  return true;
}

const BaseMaterial* PathTracer::LaneMaterialOf(const Surface& surface, const SurfaceMaterial& material,
                                               BaseMaterial* textured) const {
  if (!uses_lanes_ || strategy_ != LightStrategy::kCombined) return nullptr;
  if (surface.values != nullptr) {
    const UniformMaterial& uniform = uniform_[surface.values - surfaces_.uniform().data()];
    return uniform.is_base_only ? &uniform.base : nullptr;
  }
  if (!material.IsBaseOnly()) return nullptr;
  *textured = BaseMaterial(material, albedo_table_);
  return textured;
}

void PathTracer::SetChoiceLane(const Path& path, size_t lane, ChoiceLanes* out) const {
  out->roulette[lane] = RouletteFactor(path.vertex);
  out->is_seen[lane] = path.part == PathPart::kSeen ? 1.0f : 0.0f;
}

void PathTracer::PickLights(size_t count, VertexLanes* out) const {
  if (lights_.OnlyLeaf() != nullptr) PickLanes(*lights_.OnlyLeaf(), lights_.finite_share(), count, out);
}

LightTree::Choice PathTracer::PickedLight(const LightReceiver& receiver, size_t lane,
                                          const VertexLanes& lanes) const {
  if (const LightLeaf* leaf = lights_.OnlyLeaf())
    return {leaf->emitters[static_cast<size_t>(lanes.choice.slot[lane])], lanes.choice.probability[lane]};
  return lights_.PickFinite(receiver, lanes.random.light_and_lobe.x[lane]);
}

void PathTracer::SetLightLane(const Surface& surface, const Path& path, size_t lane, VertexLanes* out) const {
  static constexpr LightTriangle kNone;
  const LightReceiver receiver = surface.Receiver();
  out->vertices[lane].triangle = &kNone;
  out->light.is_sampled[lane] = 1;
  out->light.pdf[lane] = 0;
  if (lights_.IsEmpty() || (path.options.is_direct_only && path.part != PathPart::kSeen)) return;
  const float u_light = out->random.light_and_lobe.x[lane];
  const bool is_finite = u_light < lights_.finite_share();
  const LightTree::Choice choice =
      is_finite ? PickedLight(receiver, lane, *out) : LightTree::Choice{.emitter = 0, .probability = 0};
  if (const LightTriangle* light = lights_.PlainTriangle(choice)) {
    out->light.is_sampled[lane] = 0;
    out->vertices[lane].triangle = light;
    out->choice.probability[lane] = lights_.finite_share() * choice.probability;
    return;
  }
  const Vec2 u = out->random.light_point.At(lane);
  const LightSample sample =
      is_finite ? lights_.SampleFinite(choice, receiver.position, u) : lights_.SampleInfinite(u_light, u);
  out->light.pdf[lane] = sample.pdf;
  out->light.direction.Set(lane, sample.direction);
  out->light.distance[lane] = sample.distance;
  out->light.radiance.Set(lane, sample.radiance);
  out->light.is_delta[lane] = sample.is_delta ? 1.0f : 0.0f;
}

bool PathTracer::LeaveLane(const Hit& hit, const Surface& surface, float alpha, const ShadedLanes& shaded,
                           size_t lane, Path* path) const {
  const SeenRecord& seen = shaded.seen[lane];
  const bool is_seen = path->part == PathPart::kSeen;
  if (is_seen) {
    OpenSeen(
        hit, surface,
        {seen.diffuse_albedo, seen.glossy_albedo, seen.has_diffuse > 0, seen.has_facets > 0 ? alpha : 1.0f},
        path);
  }
  if (shaded.goes_on[lane] <= 0 || EndsHere(*path)) return false;
  if (is_seen) {
    path->seen.weight = seen.weight;
    path->seen.total_weight = seen.total_weight;
    path->options.is_direct_only = path->options.is_direct_only && MaxComponent(seen.weight.non_diffuse) <= 0;
    path->part = PathPart::kLit;
    if (path->vertex == 0) path->before = path->seen.throughput;
    path->incident = {};
  } else {
    path->incident.has_scattered = true;
  }
  path->LeaveByLane(surface);
  return true;
}

bool PathTracer::TakeBothBranches(const Surface& surface, const Bsdf& bsdf, Path* path,
                                  std::vector<Path>* branches) {
  const float inverse_probability = 1.0f / bsdf.DeltaProbability();
  BsdfSample reflected = bsdf.DeltaReflection();
  BsdfSample transmitted = bsdf.DeltaTransmission();
  reflected.weight.non_diffuse *= inverse_probability;
  transmitted.weight.non_diffuse *= inverse_probability;
  if (transmitted.valid) {
    Path other = *path;  // its light is added when the other branch has ended
    other.seen.is_open = false;
    other.random = path->random.Transmission();
    other.LeaveByDelta(surface, transmitted);
    branches->push_back(other);
  }
  if (reflected.valid) path->LeaveByDelta(surface, reflected);
  return reflected.valid;
}

void PathTracer::Trace(std::span<const Ray> rays, std::span<const Sampler> samplers,
                       std::span<LayerSample> out) const {
  PathStream stream(*this);
  stream.Add(rays, samplers, out);
  stream.Run();
}

}  // namespace lumifold::render
