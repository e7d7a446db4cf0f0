#pragma once

#include <vector>

#include "worker/render/bsdf.h"
#include "worker/render/embree_scene.h"
#include "worker/render/texture.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A point a ray has hit, with everything shading needs there.
struct Surface {
  Vec3 position;
  Vec3 geometric;    // unit face normal on the side the ray came from
  Vec3 normal;       // unit shading normal, normal map included, on the same side
  Vec3 coat_normal;  // the same of the clear coat; set only where there is one
  Vec2 uv[2];
  Footprint footprint;  // of the ray, on a material with textures
  Vec3 vertex_color = {1, 1, 1};
  bool front = true;     // the ray met the front (counter-clockwise) side
  bool radiates = true;  // the material, from one side at least
  const scene::Material* material = nullptr;
  const SurfaceMaterial* values = nullptr;  // the material's, where they are the same everywhere; else null
  float epsilon = 0;      // how far off the face a new ray must start so as not to hit it again
  float cone_width = 0;   // of the cone round the ray, here; 0 where the scene has no textures
  float cone_spread = 0;  // and by how much it widens a metre

  /// A start for rays that leave to the side `direction` points to.
  Vec3 Offset(Vec3 direction) const {
    return position + geometric * (Dot(direction, geometric) < 0 ? -epsilon : epsilon);
  }

  /// Makes `ray` the one that goes on in the direction drawn, with a chance of its own. Its cone is about as
  /// wide as the share of directions the step stands for.
  void Leave(const BsdfSample& step, uint64_t chance, Ray* ray) const;
};

/// Reconstructs surfaces from hits. Threads: safe concurrently. Keeps pointers to what it is given.
class SurfaceReader {
 public:
  SurfaceReader(const scene::Scene& scene, const TextureSampler& textures);
  SurfaceReader(const SurfaceReader&) = delete;
  SurfaceReader& operator=(const SurfaceReader&) = delete;

  /// The surface at `hit` of `ray`; must not be a miss.
  Surface Read(const Hit& hit, const Ray& ray) const;

  /// The material's values there, textures looked up.
  SurfaceMaterial Shade(const Surface& surface) const;

  /// What it radiates towards the side it was seen from.
  Vec3 Emitted(const Surface& surface) const { return surface.radiates ? EmittedBy(surface) : Vec3{}; }

 private:
  /// What Read() asks about an instance.
  struct Place {
    const scene::Mesh* mesh = nullptr;
    const scene::Material* material = nullptr;
    const SurfaceMaterial* values = nullptr;  // of the material, where they are the same everywhere
    const scene::Affine* to_world = nullptr;
    bool is_textured = false;  // the material has textures
    bool radiates = false;     // the material does
    bool is_plain = false;     // beside the face nothing is to be read: no textures, colours, smooth normals
  };

  /// Of a mesh, placed nowhere yet.
  Place PlaceOf(const scene::Scene& scene, size_t mesh_index);
  Vec3 EmittedBy(const Surface& surface) const;
  void ReadCorners(const Place& place, const Hit& hit, const Ray& ray, Surface* surface) const;
  Vec3 Color(const scene::TextureRef& ref, const Surface& surface) const;
  scene::Vec4 Data(const scene::TextureRef& ref, const Surface& surface) const;
  Vec3 BaseColor(const Surface& surface) const;
  Footprint FootprintAt(const scene::Mesh& mesh, const scene::Affine& to_world, const Hit& hit,
                        const Ray& ray, Vec3 normal) const;
  /// `normal` bent by a normal map.
  Vec3 MappedNormal(const scene::TextureRef& map, float scale, const Place& place, const Hit& hit,
                    const Surface& surface, Vec3 normal) const;
  Vec3 CoatNormal(const Place& place, const Hit& hit, const Surface& surface, Vec3 unmapped,
                  const Ray& ray) const;
  void ShadeLayers(const Surface& surface, SurfaceMaterial* out) const;

  const TextureSampler* textures_;
  scene::Material default_material_;
  std::vector<Place> places_;             // by instance
  std::vector<SurfaceMaterial> uniform_;  // by mesh
  bool any_textures_ = false;
  float epsilon_;  // share that depends on the scene's size
};

}  // namespace lumifold::render
