#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "worker/render/lights/environment.h"
#include "worker/render/lights/lights.h"
#include "worker/render/materials/bsdf.h"
#include "worker/render/sampling/sampler.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/geometry_sample.h"
#include "worker/render/tracing/layer_sample.h"
#include "worker/render/tracing/surface.h"
#include "worker/render/tracing/tracing_plan.h"
#include "worker/render/tracing/visibility.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The dimension pair of a sample that places it within its pixel.
inline constexpr uint32_t kCameraPair = 0;
/// The dimension pair that places it on the lens: above all pairs that its path uses.
inline constexpr uint32_t kLensPair = 1u << 20;

/// How light at a surface is estimated. The farm uses kCombined. The others converge to the same picture more
/// slowly and exist so that tests can compare them with it. Punctual lights are sampled in all three.
enum class LightStrategy {
  kCombined,      // both techniques, weighted by the balance heuristic
  kLightSamples,  // points sampled on the lights
  kBsdfHits,      // directions sampled from the BSDF that hit a light
};

/// Where a recorded path could have ended, and its end.
struct PathVertex {
  Vec3 gathered;         // indirect radiance so far, weighted as in the picture
  float throughput = 0;  // for Roulette::Survival; 0 at the path's end
  int64_t rays = 0;      // so far, from the first surface on
};

/// Unbiased path tracing with next-event estimation and multiple importance sampling (balance heuristic).
/// Layers keep the lobes apart at the first surface and at the surfaces seen in mirrors and through glass.
/// After those surfaces all lobes are summed, so the layers cost next to nothing. At smooth glass that the
/// camera sees directly, reflection and transmission are both traced; at every other surface one lobe is
/// sampled. Threads: safe concurrently. Keeps a reference to the scene, which must outlive the tracer.
/// Sources: Kajiya 1986; Veach 1997 chapters 9 and 10 (MIS, Russian roulette); Gruzdev et al. 2015 (layers).
class PathTracer {
 public:
  /// max_bounces: maximum number of scattering events after the first surface. Every surface still gathers
  /// direct light by both techniques.
  /// `environment` may be null. The layers that `plan` leaves out are traced all the same: they cost next to
  /// nothing.
  PathTracer(const scene::Scene& scene, const EmbreeScene& embree,
             std::shared_ptr<const Environment> environment, int max_bounces, const MipSource& mips = {},
             const TracingPlan& plan = {});

  /// Maximum number of samples that are traced together.
  static constexpr size_t kPacket = EmbreeScene::kPacket;

  /// Traces up to kPacket samples and overwrites `out`. The rays' random keys are set.
  void Trace(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<LayerSample> out) const;
  /// Finds the first surface of up to kPacket rays, and the surfaces that delta events lead to from there.
  /// The rays' random keys are set.
  void TraceGeometry(std::span<const Ray> rays, std::span<GeometrySample> out) const;

  /// Traces the path that one sample of the first surface's indirect light follows, without Russian roulette,
  /// and tells its vertices from the first bounce on. Nothing for rays that leave the scene, and where the
  /// sample is a mirror image. The ray's random key is set.
  void RecordIndirect(const Ray& ray, const Sampler& sampler, std::vector<PathVertex>* out) const;

  bool HasLights() const { return !lights_.IsEmpty(); }

 private:
  friend class ChartsAccess;  // tests and charts only

  class PathSampler;
  struct Connection;
  struct PathSegment;
  template <typename BsdfType>
  struct FirstSurface;
  struct IncidentRadiance;
  struct ScatteredRadiance;
  /// Whether paths are traced whose only contribution is the first surface's I. The farm traces them all.
  enum class Indirect { kTraced, kLeftOut };
  template <typename BsdfType>
  using FirstSurfaces = std::array<std::optional<FirstSurface<BsdfType>>, kPacket>;

  /// MIS weight of a light that a direction sampled with density `bsdf_pdf` hits, and that light sampling
  /// generates with density `light_pdf`.
  float HitWeight(float bsdf_pdf, float light_pdf) const;
  /// MIS weight of a light sample that Bsdf::Sample() generates with density `bsdf_pdf`, over the light
  /// sample's density.
  float LightSampleWeight(const LightSample& sample, float bsdf_pdf) const;
  /// Samples a point on the lights. The radiance is divided by the density and MIS-weighted against
  /// Bsdf::Sample(); visibility is not yet applied.
  template <typename BsdfType>
  Connection SampleLight(const Surface& surface, const BsdfType& bsdf, float u_light,
                         const PathSampler& random, int vertex) const;
  /// As SampleLight(), with visibility applied.
  template <typename BsdfType>
  Connection ConnectToLight(const Surface& surface, const BsdfType& bsdf, float u_light,
                            const PathSampler& random, int vertex) const;
  /// Multiplies the radiance of all connections by the transmittance of their shadow rays.
  template <typename BsdfType>
  void ApplyVisibility(FirstSurfaces<BsdfType>* surfaces) const;
  /// Radiance that the hit surface emits back along a ray sampled at `from` with density `pdf`, MIS-weighted
  /// against ConnectToLight().
  Vec3 EmittedOnHit(const LightReceiver& from, const Surface& surface, const Hit& hit, Vec3 direction,
                    float pdf) const;
  /// The same for a ray that leaves the scene.
  Vec3 EmittedOnMiss(Vec3 direction, float pdf) const;
  template <typename BsdfType = Bsdf>
  BsdfType MakeBsdf(const Surface& surface, Vec3 wo) const;
  /// Radiance incident along `segment`, which is advanced to the path's end; the surface at its first hit is
  /// path vertex number `vertex`. `path_throughput` is the throughput of the path before the segment. With
  /// Indirect::kLeftOut only the direct part is traced. If `record` is not null, the path's vertices are
  /// added there, and it goes on without Russian roulette.
  template <typename BsdfType>
  IncidentRadiance TraceIncident(PathSegment* segment, int vertex, Vec3 path_throughput,
                                 const PathSampler& random, Indirect indirect = Indirect::kTraced,
                                 std::vector<PathVertex>* record = nullptr) const;
  /// Radiance that path vertex number `vertex` scatters towards the viewer; `connection` is its light sample
  /// and `u_lobe` the random number that selects the lobe.
  template <typename BsdfType>
  ScatteredRadiance Scatter(const Surface& surface, const BsdfType& bsdf, const Connection& connection,
                            float u_lobe, int vertex, Vec3 path_throughput, const PathSampler& random,
                            Indirect indirect = Indirect::kTraced) const;
  /// The first intersection of each ray; empty for rays that miss.
  template <typename BsdfType>
  FirstSurfaces<BsdfType> IntersectFirst(std::span<const Ray> rays, std::span<const Sampler> samplers) const;
  /// The layers of a sample whose camera ray hits `first`.
  template <typename BsdfType>
  void TraceLayers(const FirstSurface<BsdfType>& first, const Sampler& sampler, Indirect indirect,
                   LayerSample* out) const;
  /// Traces the delta events that leave smooth glass at the first surface, each weighted by Fresnel.
  void TraceBothBranches(const FirstSurface<Bsdf>& first, const Sampler& sampler, LayerSample* out) const;
  /// The layers of a sample whose camera ray leaves the scene.
  void TraceMiss(const Ray& ray, LayerSample* out) const;
  /// Follows the chain of delta events that begins at the first surface with `event` of weight `throughput`,
  /// and adds one level for each surface on it.
  void TraceDeltaChain(const Surface& first, const BsdfSample& event, Vec3 throughput,
                       const PathSampler& random, LayerSample* out) const;
  /// Trace() with the code for one type of BSDF.
  template <typename BsdfType>
  void TraceWith(std::span<const Ray> rays, std::span<const Sampler> samplers,
                 std::span<LayerSample> out) const;
  /// RecordIndirect() with the code for one type of BSDF.
  template <typename BsdfType>
  void RecordWith(const Ray& ray, const Sampler& sampler, std::vector<PathVertex>* out) const;
  GeometrySample GeometryAt(const Ray& ray, const Hit& hit) const;
  /// The same chain without random decisions: at each surface the stronger delta event.
  void TraceDeltaChainGeometry(const Ray& camera_ray, const Surface& first, const BsdfSample& event,
                               GeometrySample* out) const;

  const EmbreeScene* embree_;
  TextureSampler textures_;
  SurfaceReader surfaces_;
  LightSet lights_;
  bool diffuse_only_;  // the scene is traced with DiffuseBsdf, and Bsdf looks up no albedo
  AlbedoTable albedo_table_;
  Visibility visibility_;
  int max_bounces_;
  TracingPlan plan_;
  LightStrategy strategy_ = LightStrategy::kCombined;
};

}  // namespace lumifold::render
