#include "tests/charts/methods/rendering/irradiance_picture.h"

#include <array>
#include <numeric>
#include <vector>

#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "tests/charts/methods/rendering/irradiance.h"
#include "worker/render/sampling/frame.h"

namespace lumifold::charts {
namespace {

using render::CameraPacket;
using render::ChartsAccess;
using render::Frame;
using render::IsFinite;
using render::kLensPair;
using render::LayerSample;
using render::PathTracer;
using render::Sampler;
using render::Surface;
using scene::Vec3;

/// The dimension pair for the direction of a path that replaces an unknown irradiance: past those of the
/// path.
constexpr uint32_t kFallbackPair = kLensPair + 1;

/// One-path estimate of I on a Lambertian surface.
Vec3 EstimateIndirect(const ChartsAccess& tracer, const Surface& surface, const Sampler& sampler) {
  const HemisphereStrata whole = {1, 1};
  const Vec3 direction = Frame::Of(surface.normal).ToWorld(whole.Direction(0, sampler.Get2D(kFallbackPair)));
  if (Dot(direction, surface.geometric) <= 0) return {};
  return tracer.TraceIndirect(surface, direction, sampler).radiance;
}

/// Renders the pixels of one task.
class PixelRenderer {
 public:
  PixelRenderer(const CameraFrame& frame, uint32_t samples, IrradianceLookup irradiance)
      : frame_(frame), samples_(samples), irradiance_(irradiance) {}

  /// The pixel's mean; counts the fallback paths.
  Vec3 Render(int x, int y, uint64_t* fallbacks) const {
    std::array<LayerSample, PathTracer::kPacket> layers;
    std::array<std::optional<Surface>, PathTracer::kPacket> diffuse;
    Vec3 sum;
    float count = 0;
    frame_.ForEachPacket(x, y, {0, samples_}, [&](const CameraPacket& packet) {
      frame_.tracer().TraceWithoutIndirect(packet.rays(), packet.samplers(), layers, diffuse);
      for (size_t i = 0; i < packet.size(); ++i) {
        Vec3 radiance = layers[i].combined;
        if (diffuse[i].has_value())
          radiance += layers[i].albedo * Indirect(*diffuse[i], packet.samplers()[i], x, y, fallbacks);
        if (!IsFinite(radiance)) continue;
        sum += radiance;
        count += 1;
      }
    });
    return count > 0 ? sum / count : Vec3{};
  }

 private:
  Vec3 Indirect(const Surface& surface, const Sampler& sampler, int x, int y, uint64_t* fallbacks) const {
    const std::optional<Vec3> known = irradiance_(surface, x, y);
    if (known.has_value()) return *known / kPi;
    ++*fallbacks;
    return EstimateIndirect(frame_.tracer(), surface, sampler);
  }

  const CameraFrame& frame_;
  uint32_t samples_;
  IrradianceLookup irradiance_;
};

}  // namespace

void RenderWithIrradiance(const CameraFrame& frame, uint32_t samples_per_pixel, IrradianceLookup irradiance,
                          TaskPool* pool, RenderedPicture* out) {
  const PixelRenderer renderer(frame, samples_per_pixel, irradiance);
  out->picture = MakePicture(frame.width(), frame.height());
  std::vector<uint64_t> fallbacks(static_cast<size_t>(frame.height()));
  frame.ForEachPixel(pool, [&](int x, int y) {
    PutPixel(&out->picture, x, y, renderer.Render(x, y, &fallbacks[static_cast<size_t>(y)]));
  });
  out->camera_paths += static_cast<uint64_t>(frame.pixels()) * samples_per_pixel;
  out->gather_paths = std::accumulate(fallbacks.begin(), fallbacks.end(), out->gather_paths);
}

}  // namespace lumifold::charts
