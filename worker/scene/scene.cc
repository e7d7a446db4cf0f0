#include "worker/scene/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "filter/image/portable_math.h"
#include "worker/scene/choice.h"

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

/// What a camera that looks along -z must see, in its axes.
class Extent {
 public:
  /// Tangents of half the angles of view.
  Extent(float horizontal, float vertical) : tangents_{horizontal, vertical} {}

  void Add(const Vec3& p) {
    const std::array<float, 2> sides = {p.x, p.y};
    for (size_t i = 0; i < 2; ++i) {
      upper_[i] = std::max(upper_[i], sides[i] + tangents_[i] * p.z);
      lower_[i] = std::max(lower_[i], -sides[i] + tangents_[i] * p.z);
    }
    farthest_ = std::min(farthest_, p.z);
    nearest_ = std::max(nearest_, p.z);
    is_empty_ = false;
  }
  bool is_empty() const { return is_empty_; }

  /// The nearest place from which all of it is seen, with equal margins.
  Vec3 Place() const {
    std::array<float, 2> middle = {};
    float z = nearest_ + 1e-3f * (nearest_ - farthest_) + 1e-6f;
    for (size_t i = 0; i < 2; ++i) {
      middle[i] = (upper_[i] - lower_[i]) / 2;
      z = std::max(z, (upper_[i] + lower_[i]) / (2 * tangents_[i]));
    }
    return {middle[0], middle[1], z};
  }

 private:
  static constexpr float kNone = -std::numeric_limits<float>::infinity();

  // Of all points, the largest distance to the right (above) of a plane of the view's slope through the
  // origin, and to the left (below).
  std::array<float, 2> upper_ = {kNone, kNone};
  std::array<float, 2> lower_ = {kNone, kNone};
  std::array<float, 2> tangents_;
  float nearest_ = kNone;
  float farthest_ = -kNone;
  bool is_empty_ = true;
};

/// Sees the whole scene from the front, half to the right, and a little above, as photographers show
/// products; as large as a frame of this aspect ratio allows, with a margin.
Camera FittedCamera(const Scene& scene, float aspect) {
  constexpr float kAzimuth = 0.55f;   // radians from the front towards the right
  constexpr float kElevation = 0.3f;  // radians above the horizon
  constexpr float kMargin = 1.15f;
  Camera camera;
  camera.name = "fitted";
  float sine = 0, cosine = 1;
  SinCos(kElevation, &sine, &cosine);
  float sin_turn = 0, cos_turn = 1;
  SinCos(kAzimuth, &sin_turn, &cos_turn);
  const Vec3 right = {cos_turn, 0, -sin_turn};
  const Vec3 backward = {sin_turn * cosine, sine, cos_turn * cosine};
  const Vec3 up = Cross(backward, right);
  float sin_half_fov = 0, cos_half_fov = 1;
  SinCos(camera.yfov / 2, &sin_half_fov, &cos_half_fov);
  const float vertical = sin_half_fov / cos_half_fov / kMargin;
  Extent extent(vertical * aspect, vertical);
  for (const Instance& instance : scene.instances) {
    for (const Vec3& position : scene.meshes[instance.mesh].positions) {
      const Vec3 p = instance.world_from_object.Point(position);
      extent.Add({Dot(p, right), Dot(p, up), Dot(p, backward)});
    }
  }
  const Vec3 place = extent.is_empty() ? Vec3{0, 0, 1 / sin_half_fov} : extent.Place();
  camera.world_from_camera = {right, up, backward, right * place.x + up * place.y + backward * place.z};
  return camera;
}

}  // namespace

std::array<TextureUse, 17> TexturesOf(const Material& material) {
  return {{{&material.base.color_texture, true},
           {&material.base.metallic_roughness_texture, false},
           {&material.normal_map.texture, false},
           {&material.emission.texture, true},
           {&material.specular.factor_texture, false},
           {&material.specular.color_texture, true},
           {&material.transmission.texture, false},
           {&material.clearcoat.factor_texture, false},
           {&material.clearcoat.roughness_texture, false},
           {&material.clearcoat.normal_map.texture, false},
           {&material.sheen.color_texture, true},
           {&material.sheen.roughness_texture, false},
           {&material.base.anisotropy.texture, false},
           {&material.base.diffuse_transmission.factor_texture, false},
           {&material.base.diffuse_transmission.color_texture, true},
           {&material.iridescence.factor_texture, false},
           {&material.iridescence.thickness_texture, false}}};
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

void AddShadowGround(Scene* scene) {
  const Bounds bounds = WorldBounds(*scene);
  if (bounds.IsEmpty()) return;
  const Vec3 extent = bounds.max - bounds.min;
  const float size = std::max(Length(extent), 1e-3f);
  constexpr float kWide = 20;      // of that size
  constexpr float kBelow = 1e-5f;  // so that faces on the ground are in front of it
  const Vec3 middle = (bounds.min + bounds.max) * 0.5f;
  const float y = bounds.min.y - kBelow * size;
  const float half = kWide * size;
  Mesh ground;
  for (const auto& [x, z] : {std::pair{-half, half}, {half, half}, {half, -half}, {-half, -half}})
    ground.positions.push_back({middle.x + x, y, middle.z + z});
  ground.triangles = {0, 1, 2, 0, 2, 3};
  scene->catchers.push_back({static_cast<int>(scene->meshes.size()), {}, "ground"});
  scene->meshes.push_back(std::move(ground));
}

absl::StatusOr<Camera> FindCamera(const Scene& scene, const std::string& name, float aspect) {
  if (name.empty()) return scene.cameras.empty() ? FittedCamera(scene, aspect) : scene.cameras.front();
  std::vector<std::string> names;
  for (const Camera& camera : scene.cameras) names.push_back(camera.name);
  const absl::StatusOr<int> found = Choose("camera", names, name);
  if (!found.ok()) return found.status();
  return scene.cameras[*found];
}

}  // namespace lumifold::scene
