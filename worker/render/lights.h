#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "worker/render/alias_table.h"
#include "worker/render/embree_scene.h"
#include "worker/render/environment.h"
#include "worker/render/light_tree.h"
#include "worker/render/punctual.h"
#include "worker/render/texture.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A point on a light, or a direction towards one that is infinitely far, drawn to be connected to a shading
/// point.
struct LightSample {
  scene::Vec3 direction;  // unit, towards the light
  scene::Vec3 radiance;   // that arrives; of a light without size the irradiance across `direction`
  float pdf = 0;          // per steradian; of a light without size its probability; 0: nothing was drawn
  float distance = std::numeric_limits<float>::infinity();
  bool without_size = false;  // no ray hits it by chance
};

/// All that shines in a scene: emissive triangles, punctual lights and the environment. Which of them a
/// sample goes to is decided by power, among many by a light tree; of both finite and infinitely far lights
/// at least a quarter of the samples goes to each kind, for the power of distant ones says little about what
/// gets indoors. Threads: safe concurrently. Keeps pointers to what it is given.
class LightSet {
 public:
  /// `environment` may be null.
  LightSet(const scene::Scene& scene, const TextureSampler& textures,
           std::shared_ptr<const Environment> environment);

  bool IsEmpty() const { return finite_share_ <= 0 && infinite_.IsEmpty(); }
  bool HasEnvironment() const { return environment_ != nullptr; }

  /// A light as seen from `from`; `pick` and `u` are random numbers in [0, 1). Must not be empty.
  LightSample Sample(const LightReceiver& from, float pick, scene::Vec2 u) const;

  /// The density, per steradian as seen from `from`, with which Sample() draws the point of this triangle
  /// that lies `distance` away, at a cosine `cos_light` to its normal; 0 where it is no light.
  float DensityOfHit(const LightReceiver& from, int instance, uint32_t triangle, float distance,
                     float cos_light) const;

  /// What comes from infinitely far along `direction`, and the density of Sample() there; there must be an
  /// environment.
  scene::Vec3 SkyRadiance(scene::Vec3 direction) const { return environment_->Radiance(direction); }
  float SkyDensity(scene::Vec3 direction) const { return sky_share_ * environment_->Density(direction); }

 private:
  struct Triangle {
    scene::Vec3 corner;
    scene::Vec3 edge1;
    scene::Vec3 edge2;
    scene::Vec3 normal;
    float inverse_area = 0;  // 0: no area
    scene::Vec3 radiance;    // texture left out
    bool double_sided = false;
    const scene::Material* textured = nullptr;  // its material, where that has an emission texture
    const scene::Mesh* veiled = nullptr;        // where the material is not opaque: its mesh,
    uint32_t number = 0;                        // and the triangle's number there
    scene::Vec2 uv[2][3];                       // [set][corner]
  };
  struct Powers;

  void AddInstance(const scene::Scene& scene, int index, const TextureSampler& textures,
                   std::vector<double>* powers);
  void AddTriangle(const scene::Mesh& mesh, size_t first_index, const scene::Affine& world_from_object,
                   double brightness, std::vector<double>* powers);
  void AddPunctual(const scene::Scene& scene, double scene_radius, Powers* powers);
  void AddEnvironment(std::shared_ptr<const Environment> environment, double scene_radius, Powers* powers);
  EmitterBounds BoundsOf(uint32_t emitter, double power) const;
  LightTree::Choice PickFinite(const LightReceiver& from, float pick) const;
  LightSample SampleTriangle(const Triangle& light, scene::Vec3 from, scene::Vec2 u) const;
  LightSample SamplePunctual(const PunctualEmitter& light, scene::Vec3 from) const;
  LightSample SampleInfinite(float pick, scene::Vec2 u) const;

  const scene::Scene* scene_;
  const TextureSampler* textures_;
  std::vector<Triangle> triangles_;
  std::vector<int64_t> first_of_instance_;  // index of the instance's first triangle, or -1
  std::vector<PunctualEmitter> points_;     // points and spots; as finite emitters they follow the triangles
  std::vector<PunctualEmitter> suns_;
  std::shared_ptr<const Environment> environment_;
  AliasTable finite_;  // by power; empty where there is a tree
  LightTree tree_;
  AliasTable infinite_;     // the suns, then the environment
  float finite_share_ = 0;  // of the samples
  float sky_share_ = 0;
};

}  // namespace lumifold::render
