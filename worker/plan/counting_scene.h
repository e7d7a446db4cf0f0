#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "worker/render/embree_scene.h"

namespace lumifold::plan {

/// Counts the rays that are traced in a scene. Threads: one at a time.
class CountingScene final : public render::EmbreeScene {
 public:
  explicit CountingScene(std::unique_ptr<render::EmbreeScene> scene);

  /// Rays since construction.
  int64_t rays() const { return rays_; }

  render::Hit Intersect(const render::Ray& ray) const override;
  bool IsOccluded(const render::Ray& ray) const override;
  void IntersectTogether(std::span<const render::Ray> rays, std::span<render::Hit> hits) const override;
  void AreOccludedTogether(std::span<const render::Ray> rays, std::span<bool> occluded) const override;
  render::TransparentHits FindTransparentHits(const render::Ray& ray, const render::Hit* last) const override;

 private:
  std::unique_ptr<render::EmbreeScene> scene_;
  mutable int64_t rays_ = 0;
};

}  // namespace lumifold::plan
