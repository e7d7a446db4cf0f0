#pragma once

#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <span>

#include "worker/render/bsdf.h"
#include "worker/render/embree_scene.h"
#include "worker/render/environment.h"
#include "worker/render/geometry_sample.h"
#include "worker/render/layer_sample.h"
#include "worker/render/lights.h"
#include "worker/render/sampler.h"
#include "worker/render/surface.h"
#include "worker/render/visibility.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The dimension pair of a sample that places it within its pixel.
inline constexpr uint32_t kCameraPair = 0;
/// The pair that places it on the lens: past all that its path uses.
inline constexpr uint32_t kLensPair = 1u << 20;

/// How light on a surface is estimated. All three converge to the same picture; kCombined does so fastest,
/// the others are there to be compared with it. Punctual lights can only be sampled, in all three.
enum class LightStrategy {
  kCombined,      // both, weighted by the balance heuristic
  kLightSamples,  // points drawn on the lights
  kBsdfHits,      // directions drawn from the material that happen to meet a light
};

/// Indirect light that arrives at a surface from one direction.
struct Arrival {
  Vec3 radiance;  // of light that has been scattered at least once on its way here
  float distance = std::numeric_limits<float>::infinity();  // of what is seen there, clear panes apart
};

/// Unbiased path tracing with next-event estimation and multiple importance sampling (balance heuristic).
/// The lobes of the first surface, and of those seen in mirrors and through glass, are kept apart for the
/// layers; behind them all lobes act as one, so the layers cost next to nothing. Smooth glass that is seen
/// first is followed both ways, every other surface one way. Threads: safe concurrently. Keeps a reference to
/// the scene, which must outlive it.
/// Sources: Kajiya 1986; Veach 1997 chapters 9 and 10 (MIS, Russian roulette); Gruzdev et al. 2015 (layers).
class PathTracer {
 public:
  /// max_bounces: how often a path may scatter after its first surface; each surface still gathers light by
  /// both techniques.
  /// `environment` may be null.
  PathTracer(const scene::Scene& scene, const EmbreeScene& embree,
             std::shared_ptr<const Environment> environment, int max_bounces,
             LightStrategy strategy = LightStrategy::kCombined);

  /// How many samples can be traced together.
  static constexpr size_t kPacket = EmbreeScene::kPacket;

  /// Traces up to kPacket samples; `out` is written over. The rays have their chance.
  void Trace(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<LayerSample> out) const;
  /// The samples' radiance alone, glass followed one way like all else: estimates of the same picture.
  void TraceRadiance(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<Vec3> out) const;
  /// The same as Trace() but for I, which is left black and is missing in C: paths that would bring nothing
  /// else are not followed. `diffuse` receives the first surfaces that have a diffuse lobe.
  void TraceWithoutIndirect(std::span<const Ray> rays, std::span<const Sampler> samplers,
                            std::span<LayerSample> out, std::span<std::optional<Surface>> diffuse) const;
  /// What TraceWithoutIndirect() gives of `ray` as the surface.
  std::optional<Surface> FirstDiffuseSurface(const Ray& ray) const;
  /// One path from `surface` towards unit `direction`, which is above it: I of a diffuse surface is the mean
  /// of arrivals over directions drawn by their cosine.
  Arrival TraceArrival(const Surface& surface, Vec3 direction, const Sampler& sampler) const;
  /// What up to kPacket rays meet; they have their chance.
  void TraceGeometry(std::span<const Ray> rays, std::span<GeometrySample> out) const;

  bool HasLights() const { return !lights_.IsEmpty(); }

 private:
  class Numbers;
  struct Connection;
  struct Departure;
  struct FirstSurface;
  struct Tail;
  struct Scattering;
  /// Whether paths are followed that bring nothing but the first surface's I.
  enum class Indirect { kTraced, kLeftOut };
  using FirstSurfaces = std::array<std::optional<FirstSurface>, kPacket>;

  /// The weight of a light that a direction drawn with `bsdf_pdf` has met, and that a light sample would have
  /// met with `light_pdf`.
  float HitWeight(float bsdf_pdf, float light_pdf) const;
  /// The weight of a light sample that Bsdf::Sample() would have met with `bsdf_pdf`, over its density.
  float LightSampleWeight(const LightSample& sample, float bsdf_pdf) const;
  /// A point drawn on the emitters, its light divided by its density and weighted against Bsdf::Sample().
  /// What stands in its way is still to be seen.
  Connection DrawLight(const Surface& surface, const Bsdf& bsdf, float pick, const Numbers& numbers,
                       int bounce) const;
  /// The same with what stands in its way.
  Connection ConnectToLight(const Surface& surface, const Bsdf& bsdf, float pick, const Numbers& numbers,
                            int bounce) const;
  /// Takes what stands in their way from the light of all connections.
  void Shadow(FirstSurfaces* surfaces) const;
  /// What the hit surface radiates back along a ray drawn at `from` with `pdf`, weighted against
  /// ConnectToLight().
  Vec3 EmittedOnHit(const LightReceiver& from, const Surface& surface, const Hit& hit, Vec3 direction,
                    float pdf) const;
  /// The same for a ray that leaves the scene.
  Vec3 EmittedOnMiss(Vec3 direction, float pdf) const;
  Bsdf MakeBsdf(const Surface& surface, Vec3 wo) const;
  /// Radiance that arrives along `next`, which goes on with the path, and whose first hit is the path's
  /// surface number `bounce`. `visible` is the path's throughput so far. Without indirect light it is what
  /// came in one step.
  Tail TraceTail(Departure* next, int bounce, Vec3 visible, const Numbers& numbers,
                 Indirect indirect = Indirect::kTraced) const;
  /// The light that surface number `bounce` of a path sends on, `connection` of it by a light sample; `lobe`
  /// is a random number.
  Scattering Scatter(const Surface& surface, const Bsdf& bsdf, const Connection& connection, float lobe,
                     int bounce, Vec3 visible, const Numbers& numbers,
                     Indirect indirect = Indirect::kTraced) const;
  /// Empty where a ray meets nothing.
  FirstSurfaces Meet(std::span<const Ray> rays, std::span<const Sampler> samplers) const;
  void TraceFrom(const FirstSurface& first, const Sampler& sampler, Indirect indirect,
                 LayerSample* out) const;
  /// What leaves the scene by a camera ray.
  void TraceMiss(const Ray& ray, LayerSample* out) const;
  Vec3 RadianceFrom(const FirstSurface& first, const Sampler& sampler) const;
  /// Follows a perfectly specular event of weight `throughput` from the first surface on, level by level.
  void FollowChain(const Surface& first, const BsdfSample& event, Vec3 throughput, const Numbers& numbers,
                   LayerSample* out) const;
  GeometrySample GeometryAt(const Ray& ray, const Hit& hit) const;
  void FollowChainGeometry(const Ray& camera_ray, const Surface& first, const BsdfSample& event,
                           GeometrySample* out) const;

  const EmbreeScene* embree_;
  TextureSampler textures_;
  SurfaceReader surfaces_;
  LightSet lights_;
  AlbedoTable albedo_table_;
  Visibility visibility_;
  int max_bounces_;
  LightStrategy strategy_;
};

}  // namespace lumifold::render
