#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "filter/image/tile_samples.h"
#include "worker/render/geometry/camera.h"
#include "worker/render/geometry/edge_mask.h"
#include "worker/render/lights/environment.h"
#include "worker/render/textures/mip_chain.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/path_tracer.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// What determines the picture besides the scene.
struct RenderSettings {
  int width = 0;  // pixels of the picture
  int height = 0;
  FrameWindow frame;  // where it is in the camera's frame
  PixelFilter pixel_filter;
  uint64_t seed = 0;
  int max_bounces = 8;  // scattering events after the first surface
  std::string camera;   // empty: the scene's first
  Lens lens;
  std::shared_ptr<const Environment> environment;  // null: black
  bool is_transparent = false;                     // the camera does not see it
  MipSource mips;                                  // used while the renderer is created; empty: MakeMips
  TaskPool* builders = nullptr;                    // used while it is created; null: this thread
  TracingPlan plan;                                // default: everything is modelled
};

/// Sample counts of one unit.
struct RenderCounts {
  int64_t samples = 0;
  int64_t bad_samples = 0;  // NaN or infinite: left out of the sums and of the pixel's count
  int64_t rays = 0;         // of paths and to lights
  std::atomic<int64_t>* rows =
      nullptr;  // counts rows of pixels that are done, for other threads; may be null
  const std::atomic<bool>* stop = nullptr;  // true: the rest of the unit is not wanted; may be null

  bool IsStopped() const { return stop != nullptr && stop->load(std::memory_order_relaxed); }

  /// Counts one sample; returns `is_finite`.
  bool Add(bool is_finite) {
    ++samples;
    if (!is_finite) ++bad_samples;
    return is_finite;
  }
};

/// The camera of a picture with these settings. Errors: kNotFound naming a camera that does not exist;
/// kInvalidArgument for lens values out of range or a lens with an orthographic camera.
absl::StatusOr<PictureCamera> MakeCamera(const scene::Scene& scene, const RenderSettings& settings);

/// The name of the class of machines and builds that give the same bits, e.g.
/// "lumifold-0.1.0/embree4-avx2-3f0c91ab-b5e4": version, Embree's major version and instruction set, sources,
/// and ApproximationsOfProcessor(). `other_bits`, of a device that filters frames, follow the sources
/// after "+".
std::string NumericClass(const std::string& other_bits = "");

/// Renders units of one scene. Threads: after Create() all calls are safe concurrently. One thread renders a
/// unit, and the result depends on the arguments alone.
class Renderer {
 public:
  /// Errors: those of MakeCamera; kResourceExhausted; kInternal.
  static absl::StatusOr<std::unique_ptr<Renderer>> Create(std::shared_ptr<const scene::Scene> scene,
                                                          const RenderSettings& settings);
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Traces `tile_samples` in the pixels of `rect` (within the frame) and returns their sums.
  /// Shapes: rect's size; channels, as far as the plan's layers go: for each of layers::kHalved its halves
  ///         *_a and *_b; layers::kWhole (sums over both halves); samples_a.Y, samples_b.Y (finite samples);
  ///         layers::LevelPassChannels of each level that any sample has reached; and layers::kMatte of
  ///         transparent pictures. Fragments (see
  ///         EdgedImage) of the edge pixels of RenderGeometry, which are found by four rays a pixel where the
  ///         tile's mask is not kept; counts->rays has none of these.
  /// Once counts->stop is true it returns within a few hundred samples; the result is then incomplete.
  EdgedImage RenderPass(const Rect& rect, int frame, const TileSamples& tile_samples,
                        RenderCounts* counts) const;

  /// Traces fixed sub-pixel rays in every pixel of `rect`: see RenderGeometryUnit. Once `stop`, which may be
  /// null, is true it returns within a row of pixels; the result is then incomplete.
  EdgedImage RenderGeometry(const Rect& rect, int frame, const std::atomic<bool>* stop = nullptr) const;

  const PictureCamera& camera() const { return camera_; }
  const scene::Scene& scene() const { return *scene_; }
  bool CatchesShadows() const { return catchers_ != nullptr; }

  /// Messages for the artist: the loader's warnings, a scene without lights, bad pixels of the environment.
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  friend class ChartsAccess;  // tests and charts only

  Renderer(std::shared_ptr<const scene::Scene> scene, std::unique_ptr<EmbreeScene> embree,
           std::unique_ptr<ShadowCatchers> catchers, const PictureCamera& camera,
           const RenderSettings& settings);

  /// The whole frame as the picture sees it: edges of a part of the frame are those of the frame.
  Rect FrameRect() const {
    const FrameWindow& frame = settings_.frame;
    if (frame.frame_width == 0) return {0, 0, settings_.width, settings_.height};
    return {-frame.x, -frame.y, frame.frame_width - frame.x, frame.frame_height - frame.y};
  }
  /// Finds the edge pixels of a tile, or remembers them.
  std::shared_ptr<const EdgeMask> EdgePixelsOf(const Rect& rect, const std::atomic<bool>* stop) const;
  void KeepIfComplete(std::shared_ptr<const EdgeMask> mask, const std::atomic<bool>* stop) const;

  std::shared_ptr<const scene::Scene> scene_;
  std::unique_ptr<EmbreeScene> embree_;
  std::unique_ptr<ShadowCatchers> catchers_;  // null: none
  RenderSettings settings_;
  PictureCamera camera_;
  PathTracer tracer_;
  std::vector<std::string> warnings_;
  mutable EdgeMaskCache masks_;
  size_t stream_packets_ = 16;  // that a pass traces together
};

}  // namespace lumifold::render
