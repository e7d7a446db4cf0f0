#include "worker/plan/counting_scene.h"

namespace lumifold::plan {

using render::Hit;
using render::Ray;

CountingScene::CountingScene(std::unique_ptr<render::EmbreeScene> scene) : scene_(std::move(scene)) {
  has_transparent_ = scene_->HasTransparentSurfaces();
}

Hit CountingScene::Intersect(const Ray& ray) const {
  ++rays_;
  return scene_->Intersect(ray);
}

bool CountingScene::IsOccluded(const Ray& ray) const {
  ++rays_;
  return scene_->IsOccluded(ray);
}

void CountingScene::IntersectTogether(std::span<const Ray> rays, std::span<Hit> hits) const {
  rays_ += static_cast<int64_t>(rays.size());
  scene_->IntersectTogether(rays, hits);
}

void CountingScene::AreOccludedTogether(std::span<const Ray> rays, std::span<bool> occluded) const {
  rays_ += static_cast<int64_t>(rays.size());
  scene_->AreOccludedTogether(rays, occluded);
}

render::TransparentHits CountingScene::FindTransparentHits(const Ray& ray, const Hit* last) const {
  ++rays_;
  return scene_->FindTransparentHits(ray, last);
}

}  // namespace lumifold::plan
