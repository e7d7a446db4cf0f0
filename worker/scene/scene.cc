#include "worker/scene/scene.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::scene {
namespace {

void Extend(Bounds* bounds, Vec3 p) {
  bounds->min = {std::min(bounds->min.x, p.x), std::min(bounds->min.y, p.y), std::min(bounds->min.z, p.z)};
  bounds->max = {std::max(bounds->max.x, p.x), std::max(bounds->max.y, p.y), std::max(bounds->max.z, p.z)};
}

Vec3 Corner(const Bounds& bounds, int i) {
  return {i & 1 ? bounds.max.x : bounds.min.x, i & 2 ? bounds.max.y : bounds.min.y,
          i & 4 ? bounds.max.z : bounds.min.z};
}

Camera FittedCamera(const Bounds& bounds) {
  constexpr float kElevation = 0.25f;  // radians above the horizon
  constexpr float kMargin = 1.1f;
  Camera camera;
  camera.name = "fitted";
  Vec3 center = {0, 0, 0};
  float radius = 1;
  if (!bounds.IsEmpty()) {
    center = bounds.min * 0.5f + bounds.max * 0.5f;
    radius = std::max(Length(bounds.max - center), 1e-6f);
  }
  float sine = 0, cosine = 1;
  SinCos(kElevation, &sine, &cosine);
  const Vec3 backward = {0, sine, cosine};
  float sin_half_fov = 0, cos_half_fov = 1;
  SinCos(camera.yfov / 2, &sin_half_fov, &cos_half_fov);
  const Vec3 position = center + backward * (kMargin * radius / sin_half_fov);
  camera.world_from_camera = {{1, 0, 0}, Cross(backward, {1, 0, 0}), backward, position};
  return camera;
}

}  // namespace

std::array<TextureUse, 12> TexturesOf(const Material& material) {
  return {{{&material.base_color_texture, true},
           {&material.metallic_roughness_texture, false},
           {&material.normal_texture, false},
           {&material.emission_texture, true},
           {&material.specular_texture, false},
           {&material.specular_color_texture, true},
           {&material.transmission_texture, false},
           {&material.clearcoat_texture, false},
           {&material.clearcoat_roughness_texture, false},
           {&material.clearcoat_normal_texture, false},
           {&material.sheen_color_texture, true},
           {&material.sheen_roughness_texture, false}}};
}

Bounds WorldBounds(const Scene& scene) {
  std::vector<Bounds> mesh_bounds(scene.meshes.size());
  for (size_t i = 0; i < mesh_bounds.size(); ++i) {
    for (const Vec3 p : scene.meshes[i].positions) Extend(&mesh_bounds[i], p);
  }
  Bounds world;
  for (const Instance& instance : scene.instances) {
    const Bounds& bounds = mesh_bounds[instance.mesh];
    if (bounds.IsEmpty()) continue;
    for (int i = 0; i < 8; ++i) Extend(&world, instance.world_from_object.Point(Corner(bounds, i)));
  }
  return world;
}

std::optional<Camera> FindCamera(const Scene& scene, const std::string& name) {
  if (name.empty()) return scene.cameras.empty() ? FittedCamera(WorldBounds(scene)) : scene.cameras.front();
  const auto found = std::find_if(scene.cameras.begin(), scene.cameras.end(),
                                  [&](const Camera& c) { return c.name == name; });
  if (found == scene.cameras.end()) return std::nullopt;
  return *found;
}

}  // namespace lumifold::scene
