#pragma once

#include <memory>
#include <optional>
#include <span>

#include "absl/status/statusor.h"
#include "worker/render/textures/texture.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/surface.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The catchers of a scene: surfaces that hide what is behind them from the camera, and of which the picture
/// has the shadows of the other surfaces alone. No other ray meets them, so that they change no light.
/// Threads: after Create() all calls are safe concurrently.
class ShadowCatchers {
 public:
  /// Null for a scene without catchers. Errors: those of EmbreeScene::Create.
  static absl::StatusOr<std::unique_ptr<ShadowCatchers>> Create(const scene::Scene& scene);
  ShadowCatchers(const ShadowCatchers&) = delete;
  ShadowCatchers& operator=(const ShadowCatchers&) = delete;

  /// Hits of camera rays behind a catcher become misses.
  void Hide(std::span<const Ray> rays, std::span<Hit> hits) const;

  /// The first catcher on a camera ray.
  std::optional<Surface> At(const Ray& ray) const;

 private:
  explicit ShadowCatchers(const scene::Scene& scene);

  scene::Scene scene_;  // its instances are the catchers
  std::unique_ptr<EmbreeScene> embree_;
  TextureSampler textures_;
  SurfaceReader surfaces_;
};

}  // namespace lumifold::render
