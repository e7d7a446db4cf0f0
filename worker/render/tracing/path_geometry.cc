#include "worker/render/tracing/path_tracer.h"

#include <algorithm>
#include <array>

#include "filter/image/mix_bits.h"

namespace lumifold::render {
namespace {

/// The mirrors of a chain of delta events: maps a direction seen in them to the direction of its mirror
/// image.
class MirrorChain {
 public:
  void Add(Vec3 normal) { normals_[count_++] = normal; }

  Vec3 MirrorImage(Vec3 direction) const {
    for (size_t i = count_; i-- > 0;) direction = direction - normals_[i] * (2 * Dot(direction, normals_[i]));
    return direction;
  }

 private:
  std::array<Vec3, layers::kMaxDepth> normals_;
  size_t count_ = 0;
};

/// The stronger of the two delta events; invalid if the BSDF has none.
BsdfSample StrongerDeltaEvent(const Bsdf& bsdf) {
  const BsdfSample reflection = bsdf.DeltaReflection();
  const BsdfSample transmission = bsdf.DeltaTransmission();
  if (!transmission.valid) return reflection;
  const bool reflects = reflection.valid && MaxComponent(reflection.weight.non_diffuse) >=
                                                MaxComponent(transmission.weight.non_diffuse);
  return reflects ? reflection : transmission;
}

}  // namespace

void PathTracer::TraceDeltaChainGeometry(const Ray& camera_ray, const Surface& first, const BsdfSample& event,
                                         GeometrySample* out) const {
  const layers::Branch branch =
      event.transmitted ? layers::Branch::kTransmission : layers::Branch::kReflection;
  MirrorChain mirrors;
  Surface surface = first;
  BsdfSample step = event;
  float distance = out->distance;
  for (int depth = 1; step.valid && depth <= std::min(plan_.levels, max_bounces_); ++depth) {
    if (!step.transmitted) mirrors.Add(surface.normal);
    Ray ray;
    ray.time = camera_ray.time;
    surface.SpawnRay(step, MixBits(camera_ray.random_key + static_cast<uint64_t>(depth)), &ray);
    const Hit hit = embree_->Intersect(ray);
    if (hit.IsMiss()) return;
    surface = surfaces_.Read(hit, ray);
    distance += hit.distance;
    const Bsdf bsdf = MakeBsdf(surface, -ray.direction);
    LevelGeometry& level = out->levels.Set({branch, depth});
    level.valid = bsdf.HasDiffuse();
    level.normal = mirrors.MirrorImage(surface.normal);
    level.distance = distance;
    level.instance = hit.instance;
    step = StrongerDeltaEvent(bsdf);
  }
}

GeometrySample PathTracer::GeometryAt(const Ray& ray, const Hit& hit) const {
  GeometrySample out;
  if (hit.IsMiss()) {
    if (!backdrop_.is_transparent) out.emitted = EmittedOnMiss(ray.direction, 0);
    return out;
  }
  const Surface surface = surfaces_.Read(hit, ray);
  const Bsdf bsdf = MakeBsdf(surface, -ray.direction);
  out.hit = true;
  out.valid = bsdf.HasDiffuse();
  out.position = surface.position;
  out.normal = surface.normal;
  out.geometric = surface.geometric;
  out.distance = hit.distance;
  out.instance = hit.instance;
  out.roughness = bsdf.ReflectionAlpha();
  const Vec3 transmittance = FirstTransmittance(surface, hit);
  out.albedo = transmittance * bsdf.DiffuseAlbedo();
  out.emitted = transmittance * surfaces_.Emitted(surface);
  TraceDeltaChainGeometry(ray, surface, bsdf.DeltaReflection(), &out);
  TraceDeltaChainGeometry(ray, surface, bsdf.DeltaTransmission(), &out);
  return out;
}

void PathTracer::TraceGeometry(std::span<const Ray> rays, std::span<GeometrySample> out) const {
  std::array<Hit, kPacket> hits;
  embree_->IntersectTogether(rays, hits);
  if (CatchesShadows()) backdrop_.catchers->Hide(rays, hits);
  for (size_t i = 0; i < rays.size(); ++i) out[i] = GeometryAt(rays[i], hits[i]);
}

}  // namespace lumifold::render
