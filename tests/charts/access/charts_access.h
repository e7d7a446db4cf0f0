#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>

#include "absl/functional/function_ref.h"
#include "worker/render/geometry/camera_packet.h"
#include "worker/render/renderer.h"
#include "worker/render/tracing/geometry_sample.h"
#include "worker/render/tracing/layer_sample.h"
#include "worker/render/tracing/surface.h"

/// What tests and charts ask of a renderer beyond what the farm needs. No program of the farm uses this
/// header.
namespace lumifold::render {

/// Number of dimension pairs that a path consumes at its first surface: the choices of light and lobe, the
/// point on the light, the scattered direction.
inline constexpr size_t kFirstSurfacePairs = 3;

/// One camera sample with all that determines it. (seed, frame, pixel, index) is the key of its random
/// numbers, see Sampler.
struct SampleRecord {
  int64_t pixel = 0;  // row-major number in the frame
  uint32_t index = 0;
  scene::Vec2 point;  // in the picture, in pixels
  scene::Vec2 lens;   // where its ray passes the lens, in [0, 1)^2; 0 for a pinhole
  std::array<scene::Vec2, kFirstSurfacePairs> random;
  LayerSample layers;
  GeometrySample geometry;  // of its own ray
};

/// Indirect radiance incident at a surface from one direction.
struct IndirectRadiance {
  Vec3 radiance;  // of light that was scattered at least once on its way to the surface
  float distance = std::numeric_limits<float>::infinity();  // to the first surface that is not a clear pane
};

/// Traces with the parts of a Renderer, which must outlive it. Threads: all const functions are safe
/// concurrently. Functions that take rays need a ScopedFloatEnvironment; those that take a rectangle set one
/// themselves.
class ChartsAccess {
 public:
  explicit ChartsAccess(const Renderer& renderer) : renderer_(&renderer) {}

  const PictureCamera& camera() const { return renderer_->camera_; }

  /// Replaces the light strategy with which `renderer` traces.
  static void SetLightStrategy(LightStrategy strategy, Renderer* renderer);

  /// Whether vertices are shaded side by side where they can be. The bits are the same.
  enum class Shading { kInLanes, kAlone };
  static void SetShading(Shading shading, Renderer* renderer);
  /// Sets how many packets of samples a pass traces together. The bits are the same.
  static void SetStreamPackets(size_t packets, Renderer* renderer);

  /// Traces the samples that Renderer::RenderPass would trace and calls visit for each, pixel by pixel, also
  /// for those that are not finite.
  void TraceSamples(const Rect& rect, int frame, SampleRange range,
                    absl::FunctionRef<void(const SampleRecord&)> visit) const;

  /// A pass of C and the sample counts alone, without layers; it estimates the same picture. Shapes: as
  /// Renderer::RenderPass, channels noisy_a.*, noisy_b.*, samples_a.Y and samples_b.Y.
  LayeredImage RenderRadiance(const Rect& rect, int frame, SampleRange range, RenderCounts* counts) const;

  /// One path through the centre of each pixel, all with the same random numbers: a strongly biased picture
  /// that is smooth wherever the scene is.
  /// Shapes: rect's size; channels direct.* and indirect.*; 0 for samples that are not finite.
  /// Source: the guide image of Bauszat, Eisemann & Magnor 2011.
  LayeredImage RenderGuide(const Rect& rect, int frame) const;

  /// PathTracer::Trace.
  void Trace(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<LayerSample> out) const {
    tracer().Trace(rays, samplers, out);
  }
  /// The samples' radiance alone. At smooth glass, too, one delta event is sampled.
  void TraceRadiance(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<Vec3> out) const;
  /// As Trace(), but I is black and missing in C, and paths that contribute to I alone are not traced.
  /// `diffuse` receives the first surfaces that have a diffuse lobe.
  void TraceWithoutIndirect(std::span<const Ray> rays, std::span<const Sampler> samplers,
                            std::span<LayerSample> out, std::span<std::optional<Surface>> diffuse) const;
  /// The first surface of `ray`, if it has a diffuse lobe: what TraceWithoutIndirect() puts in `diffuse`.
  std::optional<Surface> FirstDiffuseSurface(const Ray& ray) const;
  /// Traces one path from `surface` along `direction`, a unit vector above the surface. I of a diffuse
  /// surface is the mean radiance over cosine-distributed directions.
  IndirectRadiance TraceIndirect(const Surface& surface, Vec3 direction, const Sampler& sampler) const;

 private:
  const PathTracer& tracer() const { return renderer_->tracer_; }
  Ray CentreRay(int x, int y, const Sampler& sampler) const;
  /// PathTracer::Trace of paths that `set` has changed.
  void TraceAs(std::span<const Ray> rays, std::span<const Sampler> samplers, std::span<LayerSample> out,
               absl::FunctionRef<void(Path&)> set) const;

  const Renderer* renderer_;
};

}  // namespace lumifold::render
