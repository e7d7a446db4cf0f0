#pragma once

#include <cstdint>

#include "worker/render/lanes/vertex_lanes.h"
#include "worker/render/lights/light_tree.h"
#include "worker/render/materials/bsdf.h"
#include "worker/render/sampling/sampler.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/layer_sample.h"
#include "worker/render/tracing/surface.h"

namespace lumifold::render {

/// The dimension pair of a sample that places it within its pixel.
inline constexpr uint32_t kCameraPair = 0;
/// The dimension pair that places it on the lens: above all pairs that its path uses.
inline constexpr uint32_t kLensPair = 1u << 20;
/// The dimension pair that chooses its wavelength, if glass disperses it.
inline constexpr uint32_t kWavelengthPair = kLensPair + 1;
/// First dimension pair of the transmission branch of a sample: above all pairs that the other branch uses.
inline constexpr uint32_t kTransmissionPairs = 1u << 16;

/// The random numbers of a path vertex.
struct VertexNumbers {
  Vec2 light_and_lobe;
  Vec2 light_point;
  Vec2 direction;
};

/// Random numbers of one path: kPairsPerSurface dimension pairs of its sample for each path vertex. Two paths
/// of one sample use disjoint ranges of pairs.
class PathSampler {
 public:
  /// The dimension pairs of one path vertex, in order.
  enum Pair : uint32_t { kLightAndLobe, kLightPoint, kDirection, kPairsPerSurface };

  explicit PathSampler(const Sampler& sampler, uint32_t first_pair = kCameraPair + 1)
      : sampler_(&sampler), first_pair_(first_pair) {}

  VertexNumbers Draw(int vertex) const {
    return {sampler_->Get2D(PairOf(vertex, kLightAndLobe)), sampler_->Get2D(PairOf(vertex, kLightPoint)),
            sampler_->Get2D(PairOf(vertex, kDirection))};
  }
  /// Sets what RandomLanes::Draw() draws the vertex's pairs from.
  void SetLane(int vertex, size_t lane, RandomLanes* out) const {
    out->reversed_index[lane] = sampler_->reversed_index();
    for (uint32_t pair = 0; pair < kPairsPerSurface; ++pair) {
      const Sampler::Seeds seeds = sampler_->SeedsOf(PairOf(vertex, static_cast<Pair>(pair)));
      out->shuffle[pair][lane] = seeds.shuffle;
      out->scramble[pair][lane] = seeds.scramble;
    }
  }
  /// The random number of the path's wavelength.
  float ForWavelength() const { return sampler_->Get2D(kWavelengthPair).x; }
  /// Random key of the ray that leaves path vertex number `vertex`.
  uint64_t Key(int vertex) const { return sampler_->Key(PairOf(vertex, kDirection)); }

  /// Those of the sample's transmission branch.
  PathSampler Transmission() const { return PathSampler(*sampler_, kTransmissionPairs); }

 private:
  uint32_t PairOf(int vertex, Pair pair) const {
    return first_pair_ + static_cast<uint32_t>(vertex) * kPairsPerSurface + pair;
  }

  const Sampler* sampler_;
  uint32_t first_pair_;
};

/// A path vertex connected to a light sample.
struct Connection : ConnectionRecord {
  Ray shadow_ray;

  bool IsBlack() const { return MaxComponent(light) <= 0; }
};

/// Where the light of a path goes.
enum class PathPart : uint8_t {
  kSeen,  // the camera sees the next surface, itself or by delta events: its lobes are kept apart
  kLit,   // to the last surface that was seen: it arrives there along the path
  kTail,  // to the remainder: it comes from behind the last level
};

/// The last surface of a path whose lobes are kept apart. It is open until the path ends or reaches the next
/// one.
struct SeenSurface {
  bool is_open = false;
  int depth = 0;      // 0: the camera's; else its level's
  Vec3 throughput;    // of the path before it
  Vec3 direct;        // direct light that its diffuse lobe scatters, albedo left out
  Vec3 glossy;        // light that its glossy lobes scatter
  Vec3 total;         // that of all lobes, albedo included
  BsdfValue weight;   // of the step that the path took there
  Vec3 total_weight;  // the same of all lobes
};

/// Radiance that arrives at the surface where a part of a path began.
struct IncidentRadiance {
  Vec3 direct;    // emitted at the next surface
  Vec3 indirect;  // scattered there at least once
  float first_distance =
      0;  // metres to the first surface that is not a clear pane; infinity if there is none
  bool has_scattered = false;  // the path, since the part began
};

/// What is wanted of a path, and what its light is.
struct PathOptions {
  int levels = 0;               // that are kept apart
  bool is_single = false;       // at smooth glass, too, one delta event is sampled
  bool is_dispersed = false;    // its light is of one wavelength
  bool is_direct_only = false;  // of the first surface's diffuse light only the direct part
};

/// A path of a camera sample, between two surfaces.
struct Path : PathRecord {
  Ray ray;              // to the next surface
  LightReceiver from;   // the last vertex at which it scattered; clear panes do not count
  int vertex = 0;       // number of the next vertex, 0 being the camera's surface
  int scatterings = 0;  // the same, but clear panes in its present part do not count
  PathSampler random;
  PathOptions options;
  PathPart part = PathPart::kSeen;
  layers::Branch branch = layers::Branch::kReflection;  // of its levels
  SeenSurface seen;
  IncidentRadiance incident;  // of its part, if that is not kSeen
  LayerSample* out;

  Path(const Ray& camera_ray, const Sampler& sampler, int levels, LayerSample* sample)
      : ray(camera_ray), random(sampler), options{.levels = levels}, out(sample) {}

  /// Continues behind a clear pane.
  void Pass(const Surface& pane, const BsdfSample& step) {
    if (step.transmitted && pane.material->volume.dispersion > 0) options.is_dispersed = true;
    pane.SpawnRay(step, random.Key(vertex++), &ray);
  }
  /// Scatters at a surface.
  void Leave(const Surface& surface, const BsdfSample& step) {
    Pass(surface, step);
    pdf = step.pdf;
    MarkLeft(surface);
  }
  /// The same where lanes have set the ray and its density.
  void LeaveByLane(const Surface& surface) {
    ray.random_key = random.Key(vertex++);
    MarkLeft(surface);
  }
  void Begin(PathPart next, Vec3 throughput_before) {
    part = next;
    before = throughput_before;
    throughput = {1, 1, 1};
    incident = {};
  }
  /// Goes on from a seen surface by a delta event.
  void LeaveByDelta(const Surface& surface, const BsdfSample& event);

  /// Adds radiance that the next surface, or the environment, emits along the ray.
  void AddEmission(Vec3 radiance);
  /// Adds a light sample; its light is what arrives.
  void Add(const Connection& connection);
  /// Adds the light of the open seen surface, if there is one, to the sample.
  void CloseSeen();
  /// Ends the path: its light is added to the sample.
  void Finish();

 private:
  void MarkLeft(const Surface& surface) {
    from = surface.Receiver();
    ++scatterings;
  }
};

}  // namespace lumifold::render
