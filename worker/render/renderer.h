#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/layered_image.h"
#include "worker/render/camera.h"
#include "worker/render/camera_packet.h"
#include "worker/render/environment.h"
#include "worker/render/path_tracer.h"
#include "worker/render/sample_sink.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// What decides the picture beside the scene.
struct RenderSettings {
  int width = 0;  // pixels of the whole frame
  int height = 0;
  uint64_t seed = 0;
  int max_bounces = 8;  // scatterings after the first surface
  std::string camera;   // empty: the scene's first
  Lens lens;
  std::shared_ptr<const Environment> environment;  // null: black
  LightStrategy light_strategy = LightStrategy::kCombined;
  /// Passes carry C and the sample counts alone: what the layers cost and change is measured against that.
  bool radiance_only = false;
};

/// What rendering a unit counted.
struct RenderCounts {
  int64_t samples = 0;
  int64_t bad_samples = 0;  // NaN or infinite: left out of the sums and of the pixel's count
};

/// The name of the class of machines and builds that give the same bits, e.g. "lumifold-0.1.0/avx2".
std::string NumericClass();

/// Renders units of one scene. Threads: after Create() all calls are safe concurrently; a unit is rendered by
/// one thread, and its result depends on nothing but the arguments.
class Renderer {
 public:
  /// Errors: kNotFound naming a camera that does not exist; kInvalidArgument for a lens that is not one or
  /// before an orthographic camera; kResourceExhausted; kInternal.
  static absl::StatusOr<std::unique_ptr<Renderer>> Create(std::shared_ptr<const scene::Scene> scene,
                                                          const RenderSettings& settings);
  virtual ~Renderer() = default;

  /// Traces the samples of `range` in every pixel of `rect` (within the frame) and gives their sums.
  /// Shapes: rect's size; channels: for each of layers::kHalved its halves *_a and *_b; layers::kWhole (sums
  ///         over both halves); samples_a.Y, samples_b.Y (good samples); and of each level that any sample
  ///         has reached layers::LevelPassChannels.
  virtual LayeredImage RenderPass(const Rect& rect, int frame, SampleRange range,
                                  RenderCounts* counts) const = 0;

  /// Traces fixed sub-pixel rays in every pixel of `rect`: see RenderGeometryUnit.
  virtual EdgedImage RenderGeometry(const Rect& rect, int frame) const = 0;

  /// Traces the samples RenderPass would, and hands them one by one, bad ones too, to `sink`.
  virtual void TraceSamples(const Rect& rect, int frame, SampleRange range, SampleSink* sink) const = 0;

  /// Lights what is seen through the pixels' centres by one path each, all of which draw the same random
  /// numbers: what comes out is far from the truth but smooth wherever the scene is. For tests and charts.
  /// Shapes: rect's size; channels direct.* and indirect.*; what is not finite is 0.
  /// Source: the guide image of Bauszat, Eisemann & Magnor 2011.
  virtual LayeredImage TraceGuide(const Rect& rect, int frame) const = 0;

  /// What it traces with, for methods that ask for other samples than passes do. They live as long as it
  /// does; who calls them holds a ScopedFloatEnvironment.
  virtual const PathTracer& tracer() const = 0;
  virtual const PictureCamera& camera() const = 0;

  /// What the artist should know: the loader's warnings, a scene without lights, a camera made up.
  virtual const std::vector<std::string>& warnings() const = 0;
};

}  // namespace lumifold::render
