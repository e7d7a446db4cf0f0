#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "worker/render/lights/alias_table.h"
#include "worker/render/lights/environment.h"
#include "worker/render/lights/light_tree.h"
#include "worker/render/lights/punctual.h"
#include "worker/render/textures/texture.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A sampled point on a light, or a sampled direction towards an infinite light.
struct LightSample {
  scene::Vec3 direction;  // unit, towards the light
  scene::Vec3 radiance;   // incident; for a delta light the irradiance perpendicular to `direction`
  float pdf = 0;          // per steradian; for a delta light its probability; 0: no sample
  float distance = std::numeric_limits<float>::infinity();
  bool is_delta = false;  // a delta light (point, spot, directional): sampled directions cannot hit it
};

/// An emissive triangle, or a parallelogram of two. Lanes read its first numbers by fours.
struct LightTriangle {
  scene::Vec3 corner;
  float inverse_area = 0;  // 0: no area
  scene::Vec3 edge1;
  float both_sides = 0;  // 1: it emits from both
  scene::Vec3 edge2;
  float fold = 0.5f;  // see LightPoint(); a parallelogram: 0
  scene::Vec3 normal;
  float unused = 0;
  scene::Vec3 radiance;  // without texture
  float unused2 = 0;
  const scene::Material* textured = nullptr;  // its material, if that has an emission texture
  const scene::Mesh* alpha_mesh = nullptr;    // its mesh, if the material is not opaque
  uint32_t number = 0;                        // of the triangle in its mesh
  scene::Vec2 uv[2][3];                       // [set][corner]

  /// Whether it has the same radiance everywhere.
  bool IsPlain() const { return textured == nullptr && alpha_mesh == nullptr; }
};

/// All lights of a scene: emissive triangles, punctual lights and the environment. A light tree picks one of
/// the finite lights, power one of the infinite. If there are both, each kind gets at least a quarter of the
/// samples, because the power of infinite lights says little about how much of it gets indoors. Threads: safe
/// concurrently. Keeps pointers to its constructor's arguments.
class LightSet {
 public:
  /// `environment` may be null.
  LightSet(const scene::Scene& scene, const TextureSampler& textures,
           std::shared_ptr<const Environment> environment);

  bool IsEmpty() const { return finite_share_ <= 0 && infinite_.IsEmpty(); }
  bool HasEnvironment() const { return environment_ != nullptr; }

  /// Samples a light for the shading point `from`; `u_light` (selects the light) and `u` are random numbers
  /// in [0, 1). The set must not be empty.
  LightSample Sample(const LightReceiver& from, float u_light, scene::Vec2 u) const;

  /// Sample() in two steps: the finite light that `u_light` below finite_share() picks, and a sample of it.
  /// The tree has a leaf for lanes if it has few lights; then its choice is by `u_light` over
  /// finite_share().
  float finite_share() const { return finite_share_; }
  const LightLeaf* OnlyLeaf() const { return tree_.OnlyLeaf(); }
  LightTree::Choice PickFinite(const LightReceiver& from, float u_light) const {
    return tree_.Pick(from, u_light / finite_share_);
  }
  LightSample SampleFinite(const LightTree::Choice& choice, scene::Vec3 from, scene::Vec2 u) const;
  /// What remains for `u_light` from finite_share() on.
  LightSample SampleInfinite(float u_light, scene::Vec2 u) const;

  /// The picked light, if it is a plain triangle; else null.
  const LightTriangle* PlainTriangle(const LightTree::Choice& choice) const {
    const bool is_triangle = choice.probability > 0 && choice.emitter < triangles_.size();
    return is_triangle && triangles_[choice.emitter].IsPlain() ? &triangles_[choice.emitter] : nullptr;
  }

  /// The density, per steradian at `from`, with which Sample() returns the point of this triangle at
  /// `distance`, where the direction has the cosine `cos_light` to its normal; 0 if it is no light.
  float DensityOfHit(const LightReceiver& from, int instance, uint32_t triangle, float distance,
                     float cos_light) const;

  /// Radiance of the environment from `direction`, and the density of Sample() there; there must be an
  /// environment.
  scene::Vec3 EnvironmentRadiance(scene::Vec3 direction) const { return environment_->Radiance(direction); }
  float EnvironmentDensity(scene::Vec3 direction) const {
    return environment_share_ * environment_->Density(direction);
  }

 private:
  struct Powers;

  void AddInstance(const scene::Scene& scene, int index, const TextureSampler& textures, Powers* powers);
  void AddPunctual(const scene::Scene& scene, double scene_radius, Powers* powers);
  void AddEnvironment(std::shared_ptr<const Environment> environment, double scene_radius, Powers* powers);
  EmitterBounds BoundsOf(uint32_t emitter, double intensity) const;
  // Of a light that was picked with this probability. Each sample is built where the caller keeps it: a copy
  // of what was just written in parts waits for these stores.
  LightSample SampleTriangle(const LightTriangle& light, float probability, scene::Vec3 from,
                             scene::Vec2 u) const;
  LightSample SamplePunctual(const PunctualEmitter& light, float probability, scene::Vec3 from) const;

  const scene::Scene* scene_;
  const TextureSampler* textures_;
  std::vector<LightTriangle> triangles_;
  std::vector<uint32_t> emitter_of_;        // of the emissive triangles of all instances
  std::vector<int64_t> first_of_instance_;  // index there of the instance's first triangle, or -1
  std::vector<PunctualEmitter> points_;     // points and spots; finite emitters, numbered after the triangles
  std::vector<PunctualEmitter> directional_;
  std::shared_ptr<const Environment> environment_;
  LightTree tree_;               // of the finite emitters
  AliasTable infinite_;          // directional lights, then the environment
  float finite_share_ = 0;       // fraction of samples for finite lights
  float environment_share_ = 0;  // fraction of samples for the environment
};

}  // namespace lumifold::render
