#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <utility>

#include "absl/status/statusor.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "tests/charts/access/charts_access.h"
#include "worker/render/geometry/camera_packet.h"
#include "worker/render/renderer.h"
#include "worker/render/tracing/processor.h"

namespace lumifold::charts {

/// The camera and path tracer of one frame. Threads: safe concurrently.
class CameraFrame {
 public:
  /// Errors: those of Renderer::Create.
  static absl::StatusOr<CameraFrame> Create(std::shared_ptr<const scene::Scene> scene,
                                            const render::RenderSettings& settings) {
    absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
        render::Renderer::Create(std::move(scene), settings);
    if (!renderer.ok()) return renderer.status();
    return CameraFrame(*std::move(renderer), settings);
  }

  render::ChartsAccess tracer() const { return render::ChartsAccess(*renderer_); }
  const render::PictureCamera& camera() const { return tracer().camera(); }
  int width() const { return settings_.width; }
  int height() const { return settings_.height; }
  int64_t pixels() const { return static_cast<int64_t>(settings_.width) * settings_.height; }
  uint64_t seed() const { return settings_.seed; }

  /// The ray through a pixel's centre and the middle of the lens.
  render::Ray CentreRay(int x, int y) const {
    render::Ray ray =
        camera().RayThrough(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, {0.5f, 0.5f});
    ray.random_key =
        render::Sampler(seed(), 0, static_cast<int64_t>(y) * width() + x, 0).Key(render::kCameraPair);
    return ray;
  }

  /// Width of a pixel of `ray` at the surface it has hit, in metres; above 0.
  static float Footprint(const render::Ray& ray, const render::Surface& surface) {
    constexpr float kLeast = 1e-12f;
    return std::max(kLeast, ray.WidthAt(Length(surface.position - ray.origin)));
  }

  /// Calls visit(CameraPacket) for the samples of `range` of a pixel.
  template <typename Visit>
  void ForEachPacket(int x, int y, SampleRange range, Visit visit) const {
    render::ForEachCameraPacket(camera(), seed(), 0, x, y, range, visit);
  }

  /// Calls visit(i) for each i in [0, count) on the pool, in the floating-point environment of the tracer.
  template <typename Visit>
  static void ForEach(TaskPool* pool, int64_t count, Visit visit) {
    ParallelFor(pool, count, [&](int64_t i) {
      const render::ScopedFloatEnvironment environment;
      visit(i);
    });
  }
  /// Calls visit(x, y) for each pixel, row by row.
  template <typename Visit>
  void ForEachPixel(TaskPool* pool, Visit visit) const {
    ForEach(pool, height(), [&](int64_t y) {
      for (int x = 0; x < width(); ++x) visit(x, static_cast<int>(y));
    });
  }

 private:
  CameraFrame(std::unique_ptr<render::Renderer> renderer, render::RenderSettings settings)
      : renderer_(std::move(renderer)), settings_(std::move(settings)) {}

  std::unique_ptr<render::Renderer> renderer_;
  render::RenderSettings settings_;
};

/// Writes one pixel of a picture.
inline void PutPixel(Picture* picture, int x, int y, scene::Vec3 value) {
  for (int c = 0; c < 3; ++c) (*picture)[static_cast<size_t>(c)].At(x, y) = value[c];
}

}  // namespace lumifold::charts
