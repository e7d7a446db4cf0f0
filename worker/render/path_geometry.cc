#include "worker/render/path_tracer.h"

#include <algorithm>
#include <array>

#include "filter/image/mix_bits.h"

namespace lumifold::render {
namespace {

/// The mirrors of a chain, so that what is seen in them can be turned back to where it seems to be.
class Mirrors {
 public:
  void Add(Vec3 normal) { normals_[count_++] = normal; }

  Vec3 TurnedBack(Vec3 direction) const {
    for (size_t i = count_; i-- > 0;) direction = direction - normals_[i] * (2 * Dot(direction, normals_[i]));
    return direction;
  }

 private:
  std::array<Vec3, layers::kMaxDepth> normals_;
  size_t count_ = 0;
};

/// The stronger of the two perfectly specular events; invalid where there is none.
BsdfSample StrongerEvent(const Bsdf& bsdf) {
  const BsdfSample reflection = bsdf.PerfectReflection();
  const BsdfSample transmission = bsdf.PerfectTransmission();
  if (!transmission.valid) return reflection;
  const bool reflects = reflection.valid && MaxComponent(reflection.weight.specular) >=
                                                MaxComponent(transmission.weight.specular);
  return reflects ? reflection : transmission;
}

}  // namespace

void PathTracer::FollowChainGeometry(const Ray& camera_ray, const Surface& first, const BsdfSample& event,
                                     GeometrySample* out) const {
  const layers::Branch branch =
      event.transmitted ? layers::Branch::kTransmission : layers::Branch::kReflection;
  Mirrors mirrors;
  Surface surface = first;
  BsdfSample step = event;
  float distance = out->distance;
  for (int depth = 1; step.valid && depth <= std::min(layers::kMaxDepth, max_bounces_); ++depth) {
    if (!step.transmitted) mirrors.Add(surface.normal);
    Ray ray;
    surface.Leave(step, MixBits(camera_ray.chance + static_cast<uint64_t>(depth)), &ray);
    const Hit hit = embree_->Intersect(ray);
    if (hit.IsMiss()) return;
    surface = surfaces_.Read(hit, ray);
    distance += hit.distance;
    const Bsdf bsdf = MakeBsdf(surface, -ray.direction);
    LevelGeometry& level = out->levels.Set({branch, depth});
    level.valid = bsdf.HasDiffuse();
    level.normal = mirrors.TurnedBack(surface.normal);
    level.distance = distance;
    level.instance = hit.instance;
    step = StrongerEvent(bsdf);
  }
}

GeometrySample PathTracer::GeometryAt(const Ray& ray, const Hit& hit) const {
  GeometrySample out;
  if (hit.IsMiss()) {
    out.emitted = EmittedOnMiss(ray.direction, 0);
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
  out.roughness = bsdf.SpecularAlpha();
  out.albedo = bsdf.DiffuseAlbedo();
  out.emitted = surfaces_.Emitted(surface);
  FollowChainGeometry(ray, surface, bsdf.PerfectReflection(), &out);
  FollowChainGeometry(ray, surface, bsdf.PerfectTransmission(), &out);
  return out;
}

void PathTracer::TraceGeometry(std::span<const Ray> rays, std::span<GeometrySample> out) const {
  std::array<Hit, kPacket> hits;
  embree_->IntersectTogether(rays, hits);
  for (size_t i = 0; i < rays.size(); ++i) out[i] = GeometryAt(rays[i], hits[i]);
}

}  // namespace lumifold::render
