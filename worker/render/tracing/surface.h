#pragma once

#include <optional>
#include <span>
#include <vector>

#include "worker/render/lights/light_tree.h"
#include "worker/render/materials/bsdf.h"
#include "worker/render/textures/texture.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A point that a ray hits, with everything that shading needs.
struct Surface : SurfaceRecord {
  Vec3 coat_normal;  // shading normal of the clear coat; set only if there is one
  Vec3 anisotropy;   // SurfaceMaterial::anisotropy; set only if the material has any
  Vec2 uv[2];
  Footprint footprint;  // of the ray's cone; set only for materials with textures
  Vec3 vertex_color = {1, 1, 1};
  bool front = true;        // the ray hit the front (counter-clockwise) side
  bool is_emissive = true;  // the material emits from at least one side
  bool is_base = false;     // it has no lobes but those of SurfaceReader::Kind::kBase
  const scene::Material* material = nullptr;
  const SurfaceMaterial* values = nullptr;  // the material's, if they are the same everywhere; else null

  /// The origin for rays that leave along `direction`.
  Vec3 Offset(Vec3 direction) const {
    return position + geometric * (Dot(direction, geometric) < 0 ? -epsilon : epsilon);
  }

  /// What lights are picked for: the base reflects nothing that comes from below its shading normal.
  LightReceiver Receiver() const { return {position, normal, !is_base}; }

  /// Sets `ray` to the ray that leaves in the sampled direction. Its cone covers about the solid angle that
  /// the sample represents.
  void SpawnRay(const BsdfSample& step, uint64_t random_key, Ray* ray) const;
};

/// Computes surfaces from hits. Threads: safe concurrently. Keeps pointers to its constructor's arguments.
class SurfaceReader {
 public:
  SurfaceReader(const scene::Scene& scene, const TextureSampler& textures);
  SurfaceReader(const SurfaceReader&) = delete;
  SurfaceReader& operator=(const SurfaceReader&) = delete;

  /// The surface at `hit` of `ray`, which must not be a miss.
  Surface Read(const Hit& hit, const Ray& ray) const {
    Surface surface;
    Read(hit, ray, &surface);
    return surface;
  }
  /// The same in a place that may have held another surface.
  void Read(const Hit& hit, const Ray& ray, Surface* surface) const;

  /// What lobes the surfaces of an instance have, as far as its material's factors tell.
  enum class Kind : uint8_t {
    kDiffuse,  // the diffuse one alone
    kBase,     // perhaps rough reflection too
    kRare,     // perhaps others
  };
  Kind KindOf(int instance) const { return instances_[instance].kind; }

  /// The material's values at the surface, with textures applied.
  SurfaceMaterial Shade(const Surface& surface) const;

  /// What Surface::values points to.
  std::span<const SurfaceMaterial> uniform() const { return uniform_; }

  /// Radiance emitted towards the side that the ray came from.
  Vec3 Emitted(const Surface& surface) const { return surface.is_emissive ? EmittedBy(surface) : Vec3{}; }

 private:
  /// The data of one instance that Read() needs.
  struct InstanceData {
    const scene::Mesh* mesh = nullptr;
    const scene::Material* material = nullptr;
    const SurfaceMaterial* values = nullptr;  // of the material, if they are the same everywhere
    const scene::Affine* to_world = nullptr;
    bool is_textured = false;  // the material has textures
    bool is_emissive = false;  // the material emits
    Kind kind = Kind::kDiffuse;
    bool is_plain = false;  // flat, without textures and vertex colours: the face suffices
  };

  /// The data of a mesh, without a transform.
  InstanceData DataOf(const scene::Scene& scene, size_t mesh_index);
  Vec3 EmittedBy(const Surface& surface) const;
  void ReadCorners(const InstanceData& instance, const Hit& hit, const Ray& ray, Surface* surface) const;
  Vec3 Color(const scene::TextureRef& ref, const Surface& surface) const;
  scene::Vec4 Data(const scene::TextureRef& ref, const Surface& surface) const;
  Vec3 BaseColor(const Surface& surface) const;
  Footprint FootprintAt(const scene::Mesh& mesh, const scene::Affine& to_world, const Hit& hit,
                        const Ray& ray, Vec3 normal) const;
  /// The axes of the mesh's texture coordinates in the plane across `normal`.
  struct Tangents {
    Vec3 tangent;
    Vec3 bitangent;
  };
  static std::optional<Tangents> TangentsAt(const InstanceData& instance, const Hit& hit, bool front,
                                            Vec3 normal);
  Vec3 AnisotropyAt(const Tangents& axes, const Surface& surface) const;
  /// `normal` perturbed by a normal map.
  Vec3 MappedNormal(const scene::TextureRef& map, float scale, const InstanceData& instance, const Hit& hit,
                    const Surface& surface, Vec3 normal) const;
  Vec3 CoatNormal(const InstanceData& instance, const Hit& hit, const Surface& surface, Vec3 unmapped,
                  const Ray& ray) const;
  void ShadeFilm(const Surface& surface, SurfaceMaterial* out) const;
  void ShadeLayers(const Surface& surface, SurfaceMaterial* out) const;

  const TextureSampler* textures_;
  scene::Material default_material_;
  std::vector<InstanceData> instances_;   // by instance
  std::vector<SurfaceMaterial> uniform_;  // by mesh
  bool any_textures_ = false;
  float epsilon_;  // the part of Surface::epsilon that depends on the scene's size
};

}  // namespace lumifold::render
