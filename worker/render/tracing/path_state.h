#pragma once

#include <cstdint>
#include <optional>

#include "worker/render/tracing/path_tracer.h"

/// State of a path while it is traced: private types of PathTracer, shared by the files that implement it.
namespace lumifold::render {

inline LightReceiver ReceiverAt(const Surface& surface) { return {surface.position, surface.normal}; }

/// Random numbers of one path: kPairsPerSurface dimension pairs of its sample for each path vertex. Two paths
/// of one sample use disjoint ranges of pairs.
class PathTracer::PathSampler {
 public:
  /// The dimension pairs of one path vertex, in order.
  enum Pair : uint32_t { kLightAndLobe, kLightPoint, kDirection, kPairsPerSurface };

  explicit PathSampler(const Sampler& sampler, uint32_t first_pair = kCameraPair + 1)
      : sampler_(&sampler), first_pair_(first_pair) {}

  Vec2 Get2D(int vertex, Pair pair) const { return sampler_->Get2D(PairOf(vertex, pair)); }
  /// Random key of the ray that leaves path vertex number `vertex`.
  uint64_t Key(int vertex) const { return sampler_->Key(PairOf(vertex, kDirection)); }

 private:
  uint32_t PairOf(int vertex, Pair pair) const {
    return first_pair_ + static_cast<uint32_t>(vertex) * kPairsPerSurface + pair;
  }

  const Sampler* sampler_;
  uint32_t first_pair_;
};

/// A path vertex connected to a light sample.
struct PathTracer::Connection {
  BsdfValue value;
  Vec3 light;  // incident radiance over its density, MIS-weighted; black: no light was sampled
  Ray ray;     // shadow ray

  bool IsBlack() const { return MaxComponent(light) <= 0; }
};

/// The segment from one path vertex to the next.
struct PathTracer::PathSegment {
  Ray ray;
  LightReceiver from;  // the last vertex at which the path scattered; clear panes do not count
  float pdf = 0;       // density with which the direction was sampled there; 0 for a delta event

  PathSegment(const Surface& surface, const BsdfSample& step, uint64_t random_key) {
    Set(surface, step, random_key);
  }

  void Set(const Surface& surface, const BsdfSample& step, uint64_t random_key) {
    surface.SpawnRay(step, random_key, &ray);
    from = ReceiverAt(surface);
    pdf = step.pdf;
  }
};

/// Radiance incident along a segment.
struct PathTracer::IncidentRadiance {
  Vec3 direct;    // emitted at the segment's end
  Vec3 indirect;  // scattered there at least once
  float first_distance =
      0;  // metres to the first surface that is not a clear pane; infinity if there is none
};

/// Radiance that a path vertex scatters towards the viewer by its diffuse and glossy lobes, and the delta
/// event that was sampled, if one was.
struct PathTracer::ScatteredRadiance {
  Vec3 direct;    // direct light scattered by the diffuse lobe, albedo left out
  Vec3 indirect;  // indirect light scattered by the diffuse lobe, albedo left out
  Vec3 glossy;    // all light scattered by glossy lobes
  Vec3 total;     // the sum of all, albedo included
  BsdfSample delta_event;
};

/// The first intersection of a camera ray with its light sample.
template <typename BsdfType>
struct PathTracer::FirstSurface {
  Surface surface;
  BsdfType bsdf;
  Connection connection;
  float u_lobe;  // random number that selects the lobe
  int instance;
  float distance;  // along the camera ray

  FirstSurface(const PathTracer& tracer, const Hit& hit, const Ray& ray, const PathSampler& random)
      : FirstSurface(tracer, hit, ray, random, random.Get2D(0, PathSampler::kLightAndLobe)) {}

 private:
  FirstSurface(const PathTracer& tracer, const Hit& hit, const Ray& ray, const PathSampler& random,
               Vec2 light_and_lobe)
      : surface(tracer.surfaces_.Read(hit, ray)),
        bsdf(tracer.MakeBsdf<BsdfType>(surface, -ray.direction)),
        connection(tracer.SampleLight(surface, bsdf, light_and_lobe.x, random, 0)),
        u_lobe(light_and_lobe.y),
        instance(hit.instance),
        distance(hit.distance) {}
};

}  // namespace lumifold::render
