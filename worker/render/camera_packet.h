#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "filter/image/sample_range.h"
#include "worker/render/camera.h"
#include "worker/render/path_tracer.h"
#include "worker/render/sample_sink.h"
#include "worker/render/sampler.h"

namespace lumifold::render {

/// Samples of one pixel that are traced together.
class CameraPacket {
 public:
  /// Of pixel (x, y) the samples of `range`, whose streams are the first of `packet`.
  CameraPacket(const PictureCamera& camera, int x, int y, const SamplerPacket& packet, SampleRange range)
      : range_(range), samplers_(packet.samplers().first(range.last - range.first)) {
    for (size_t i = 0; i < size(); ++i) {
      const Vec2 jitter = samplers_[i].Get2D(kCameraPair);
      points_[i] = {static_cast<float>(x) + jitter.x, static_cast<float>(y) + jitter.y};
      if (camera.HasLens()) lens_points_[i] = samplers_[i].Get2D(kLensPair);
      camera.SetRay(points_[i], lens_points_[i], 1, &rays_[i]);
      rays_[i].chance = samplers_[i].Key(kCameraPair);
    }
  }

  size_t size() const { return samplers_.size(); }
  std::span<const Ray> rays() const { return {rays_.data(), size()}; }
  std::span<const Sampler> samplers() const { return samplers_; }
  /// The sample's number in the pixel, where it lies in the picture, and where its ray passes the lens.
  uint32_t Index(size_t i) const { return range_.first + static_cast<uint32_t>(i); }
  Vec2 Point(size_t i) const { return points_[i]; }
  Vec2 LensPoint(size_t i) const { return lens_points_[i]; }
  /// What the first surface draws from.
  std::array<Vec2, kFirstSurfacePairs> FirstSurfaceNumbers(size_t i) const {
    std::array<Vec2, kFirstSurfacePairs> numbers;
    for (uint32_t pair = 0; pair < kFirstSurfacePairs; ++pair)
      numbers[pair] = samplers_[i].Get2D(kCameraPair + 1 + pair);
    return numbers;
  }

 private:
  SampleRange range_;
  std::span<const Sampler> samplers_;
  std::array<Ray, PathTracer::kPacket> rays_;
  std::array<Vec2, PathTracer::kPacket> points_;
  std::array<Vec2, PathTracer::kPacket> lens_points_;
};

static_assert(PathTracer::kPacket == DrawnPairs::kSamples);

/// Calls visit(CameraPacket) for the samples of pixel (x, y) of a frame `width` wide. What comes together
/// depends on the range alone.
template <typename Visit>
void ForEachCameraPacket(const PictureCamera& camera, uint64_t seed, int frame, int width, int x, int y,
                         SampleRange range, Visit visit) {
  const int64_t pixel = static_cast<int64_t>(y) * width + x;
  for (uint32_t first = range.first; first < range.last; first += PathTracer::kPacket) {
    const SamplerPacket samplers(seed, frame, pixel, first);
    const SampleRange together = {first, std::min<uint32_t>(range.last, first + PathTracer::kPacket)};
    visit(CameraPacket(camera, x, y, samplers, together));
  }
}

}  // namespace lumifold::render
