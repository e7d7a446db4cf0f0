#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "filter/image/sample_range.h"
#include "worker/render/geometry/camera.h"
#include "worker/render/sampling/sampler.h"
#include "worker/render/tracing/path_tracer.h"

namespace lumifold::render {

/// Camera samples of one pixel that are traced together.
class CameraPacket {
 public:
  /// The samples of `range` in pixel (x, y); their samplers are the first of `packet`.
  CameraPacket(const PictureCamera& camera, int x, int y, const SamplerPacket& packet, SampleRange range)
      : range_(range), samplers_(packet.samplers().first(range.last - range.first)) {
    for (size_t i = 0; i < size(); ++i) {
      const Vec2 jitter = samplers_[i].Get2D(kCameraPair);
      points_[i] = camera.PointIn(x, y, jitter);
      if (camera.HasLens()) lens_points_[i] = samplers_[i].Get2D(kLensPair);
      camera.SetRay(points_[i], lens_points_[i], 1, &rays_[i]);
      rays_[i].random_key = samplers_[i].Key(kCameraPair);
    }
  }

  size_t size() const { return samplers_.size(); }
  std::span<const Ray> rays() const { return {rays_.data(), size()}; }
  std::span<const Sampler> samplers() const { return samplers_; }
  /// Sample number in the pixel.
  uint32_t Index(size_t i) const { return range_.first + static_cast<uint32_t>(i); }
  /// Position in the frame in pixels.
  Vec2 Point(size_t i) const { return points_[i]; }
  /// Where the ray passes the lens, in [0, 1)^2; 0 for a pinhole.
  Vec2 LensPoint(size_t i) const { return lens_points_[i]; }

 private:
  SampleRange range_;
  std::span<const Sampler> samplers_;
  std::array<Ray, PathTracer::kPacket> rays_;
  std::array<Vec2, PathTracer::kPacket> points_;
  std::array<Vec2, PathTracer::kPacket> lens_points_;
};

static_assert(PathTracer::kPacket == SamplerPacket::kSamples);

/// Calls visit(CameraPacket) for the samples of pixel (x, y) of the picture. The division into packets
/// depends on the range alone. `visit` may return a bool; false ends it.
template <typename Visit>
void ForEachCameraPacket(const PictureCamera& camera, uint64_t seed, int frame, int x, int y,
                         SampleRange range, Visit visit) {
  const int64_t pixel = camera.NumberOf(x, y);
  for (uint32_t first = range.first; first < range.last; first += PathTracer::kPacket) {
    const SamplerPacket samplers(seed, frame, pixel, first);
    const SampleRange together = {first, std::min<uint32_t>(range.last, first + PathTracer::kPacket)};
    const CameraPacket packet(camera, x, y, samplers, together);
    if constexpr (std::is_same_v<decltype(visit(packet)), bool>) {
      if (!visit(packet)) return;
    } else {
      visit(packet);
    }
  }
}

}  // namespace lumifold::render
