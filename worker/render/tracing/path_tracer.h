#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "worker/render/lanes/vertex_lanes.h"
#include "worker/render/lights/environment.h"
#include "worker/render/lights/lights.h"
#include "worker/render/materials/bsdf.h"
#include "worker/render/sampling/sampler.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/geometry_sample.h"
#include "worker/render/tracing/layer_sample.h"
#include "worker/render/tracing/path.h"
#include "worker/render/tracing/shadow_catchers.h"
#include "worker/render/tracing/surface.h"
#include "worker/render/tracing/tracing_plan.h"
#include "worker/render/tracing/visibility.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// How light at a surface is estimated. The farm uses kCombined. The others converge to the same picture more
/// slowly and exist so that tests can compare them with it. Punctual lights are sampled in all three.
enum class LightStrategy {
  kCombined,      // both techniques, weighted by the balance heuristic
  kLightSamples,  // points sampled on the lights
  kBsdfHits,      // directions sampled from the BSDF that hit a light
};

/// What the camera sees where it sees no surface.
struct Backdrop {
  bool is_transparent = false;               // nothing; else the environment
  const ShadowCatchers* catchers = nullptr;  // null: none
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
             const TracingPlan& plan = {}, const Backdrop& backdrop = {});

  /// Finds the solids that the camera is inside of: light on its way to `camera` is absorbed there.
  void SetCamera(Vec3 camera) { around_camera_ = SolidsAround(camera); }

  /// Maximum number of samples that are traced together.
  static constexpr size_t kPacket = EmbreeScene::kPacket;

  /// Traces up to kPacket samples and overwrites `out`. The rays' random keys are set.
  void Trace(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<LayerSample> out) const;
  /// Adds the shadows on catchers to traced samples.
  void CatchShadows(std::span<const Ray> rays, std::span<const Sampler> samplers,
                    std::span<LayerSample> samples) const;
  bool CatchesShadows() const { return backdrop_.catchers != nullptr; }
  /// Finds the first surface of up to kPacket rays, and the surfaces that delta events lead to from there.
  /// The rays' random keys are set.
  void TraceGeometry(std::span<const Ray> rays, std::span<GeometrySample> out) const;

  bool HasLights() const { return !lights_.IsEmpty(); }

 private:
  friend class ChartsAccess;  // tests and charts only
  friend class PathStream;

  /// A material that is the same everywhere on its meshes.
  struct UniformMaterial {
    BaseMaterial base;
    bool is_base_only;
  };

  /// Gathers the emission at the end of a path's ray. Returns whether the path may scatter at `surface`,
  /// which then is set.
  bool Reach(const Hit& hit, Path* path, Surface* surface) const;
  /// Samples a light and the next direction. Returns whether the path goes on. `connection`, which must be
  /// black, receives the light sample, without visibility. Smooth glass that the camera sees adds the path of
  /// its transmission to `branches`.
  bool Scatter(const Hit& hit, const Surface& surface, const SurfaceMaterial& material,
               const VertexNumbers& random, Path* path, Connection* connection,
               std::vector<Path>* branches) const;
  /// The same by lanes, for materials of which this is not null: sets what ShadeLanes() reads, and does what
  /// follows from its result. `textured` is where the result may be kept.
  const BaseMaterial* LaneMaterialOf(const Surface& surface, const SurfaceMaterial& material,
                                     BaseMaterial* textured) const;
  void SetChoiceLane(const Path& path, size_t lane, ChoiceLanes* out) const;
  void PickLights(size_t count, VertexLanes* out) const;
  LightTree::Choice PickedLight(const LightReceiver& receiver, size_t lane, const VertexLanes& lanes) const;
  void SetLightLane(const Surface& surface, const Path& path, size_t lane, VertexLanes* out) const;
  bool LeaveLane(const Hit& hit, const Surface& surface, float alpha, const ShadedLanes& shaded, size_t lane,
                 Path* path) const;
  /// MIS weight of a light that a direction sampled with density `bsdf_pdf` hits, and that light sampling
  /// generates with density `light_pdf`.
  float HitWeight(float bsdf_pdf, float light_pdf) const;
  /// MIS weight of a light sample that Bsdf::Sample() generates with density `bsdf_pdf`, over the light
  /// sample's density.
  float LightSampleWeight(const LightSample& sample, float bsdf_pdf) const;
  /// Samples a point on the lights. The radiance is divided by the density and MIS-weighted against
  /// Bsdf::Sample().
  void SampleLight(const Surface& surface, const Bsdf& bsdf, const VertexNumbers& random, const Path& path,
                   Connection* out) const;
  /// Radiance that the hit surface emits back along the path's ray, MIS-weighted against SampleLight().
  Vec3 EmittedOnHit(const Surface& surface, const Hit& hit, const Path& path) const;
  /// The same for a ray that leaves the scene.
  Vec3 EmittedOnMiss(Vec3 direction, float pdf) const;
  /// The materials of the absorbing solids around a point: rays in all directions leave them once more than
  /// they enter them, which holds for no mesh that is not closed.
  std::vector<const scene::Material*> SolidsAround(Vec3 point) const;
  /// What is left of light from the first surface to the camera.
  Vec3 FirstTransmittance(const Surface& surface, const Hit& hit) const;
  CaughtShadow ShadowOn(const Surface& catcher, const Sampler& sampler, float time) const;
  Bsdf MakeBsdf(const Surface& surface, Vec3 wo) const;
  /// The same where a path may be of one wavelength.
  Bsdf BsdfOnPath(const Surface& surface, const SurfaceMaterial& material, const Path& path) const;
  /// How a path goes on from a vertex that it was at with this probability of survival. Returns whether it
  /// does.
  bool TakeStep(const Surface& surface, Vec3 diffuse_albedo, const BsdfSample& step, float survival,
                Path* path) const;
  bool TakeSeenStep(const Surface& surface, Vec3 diffuse_albedo, BsdfSample step, float survival,
                    Path* path) const;
  /// Whether nothing is wanted of what a path would find after its next vertex.
  bool EndsHere(const Path& path) const;
  /// Both delta events that leave smooth glass at the first surface, each weighted by Fresnel.
  static bool TakeBothBranches(const Surface& surface, const Bsdf& bsdf, Path* path,
                               std::vector<Path>* branches);

  GeometrySample GeometryAt(const Ray& ray, const Hit& hit) const;
  /// The chain of delta events without random decisions: at each surface the stronger one.
  void TraceDeltaChainGeometry(const Ray& camera_ray, const Surface& first, const BsdfSample& event,
                               GeometrySample* out) const;

  const EmbreeScene* embree_;
  TextureSampler textures_;
  SurfaceReader surfaces_;
  LightSet lights_;
  AlbedoTable albedo_table_;
  std::vector<UniformMaterial> uniform_;  // of SurfaceReader::uniform()
  Visibility visibility_;
  int max_bounces_;
  TracingPlan plan_;
  Backdrop backdrop_;
  std::vector<const scene::Material*> around_camera_;
  LightStrategy strategy_ = LightStrategy::kCombined;  // another one has no lanes
  bool uses_lanes_ = true;
};

}  // namespace lumifold::render
