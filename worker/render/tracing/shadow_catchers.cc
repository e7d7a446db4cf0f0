#include "worker/render/tracing/shadow_catchers.h"

#include <map>
#include <utility>

namespace lumifold::render {
namespace {

/// The catchers as a scene of their own, all of the default material.
scene::Scene SceneOfCatchers(const scene::Scene& scene) {
  scene::Scene catchers;
  std::map<int, int> meshes;
  for (const scene::Instance& catcher : scene.catchers) {
    const auto [mesh, is_new] = meshes.try_emplace(catcher.mesh, static_cast<int>(catchers.meshes.size()));
    if (is_new) {
      const scene::Mesh& source = scene.meshes[catcher.mesh];
      scene::Mesh& copy = catchers.meshes.emplace_back();
      copy.positions = source.positions;
      copy.triangles = source.triangles;
    }
    catchers.instances.push_back({mesh->second, catcher.world_from_object, catcher.name});
  }
  return catchers;
}

}  // namespace

ShadowCatchers::ShadowCatchers(const scene::Scene& scene)
    : scene_(SceneOfCatchers(scene)), textures_(scene_), surfaces_(scene_, textures_) {}

absl::StatusOr<std::unique_ptr<ShadowCatchers>> ShadowCatchers::Create(const scene::Scene& scene) {
  if (scene.catchers.empty()) return nullptr;
  std::unique_ptr<ShadowCatchers> catchers(new ShadowCatchers(scene));  // the constructor is private
  absl::StatusOr<std::unique_ptr<EmbreeScene>> embree = EmbreeScene::Create(catchers->scene_);
  if (!embree.ok()) return embree.status();
  catchers->embree_ = *std::move(embree);
  return catchers;
}

void ShadowCatchers::Hide(std::span<const Ray> rays, std::span<Hit> hits) const {
  constexpr float kNearer = 1 - 1e-4f;  // what lies on a catcher is in front of it
  for (size_t i = 0; i < rays.size(); ++i) {
    if (hits[i].IsMiss()) continue;
    const Hit catcher = embree_->Intersect(rays[i]);
    if (!catcher.IsMiss() && catcher.distance < kNearer * hits[i].distance) hits[i] = {};
  }
}

std::optional<Surface> ShadowCatchers::At(const Ray& ray) const {
  const Hit hit = embree_->Intersect(ray);
  if (hit.IsMiss()) return std::nullopt;
  return surfaces_.Read(hit, ray);
}

}  // namespace lumifold::render
