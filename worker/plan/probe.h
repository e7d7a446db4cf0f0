#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/render/renderer.h"
#include "worker/scene/scene.h"

namespace lumifold::plan {

/// What a few samples at low resolution tell of a frame.
struct Probe {
  int width = 0;  // of the probe's picture: the frame's aspect ratio, see RunProbe
  int height = 0;
  int64_t samples = 0;  // camera samples of the whole probe
  int64_t rays = 0;     // all that were traced, camera and shadow rays included: the probe's cost

  std::vector<float> rays_of_pixel;  // rays per sample, row-major

  /// [d]: of the radiance in one block of kBlock x kBlock pixels, the share that comes from levels of depth d
  /// or more; the greatest over all blocks. [0] is not used.
  std::array<double, layers::kMaxDepth + 1> level_share = {};

  double noise = 0;  // mean over the pixels of the relative variance of one sample's luminance

  /// Mean of rays_of_pixel over the pixels that part `rect` of a frame of this size covers.
  double RaysPerSample(const Rect& rect, int frame_width, int frame_height) const;
  /// Mean over the frame.
  double RaysPerSample() const { return RaysPerSample({0, 0, width, height}, width, height); }
};

inline constexpr uint32_t kProbeSamples = 8;   // per pixel
inline constexpr int kProbePixels = 4096;      // at most, but for rounding
inline constexpr int kLeastProbePixels = 256;  // unless the frame has fewer
/// The part of the job's samples that its probe may have, one in: a plan saves a few of a hundred.
inline constexpr int kSamplesPerProbeSample = 256;
inline constexpr int kBlock = 8;

/// Traces the probe of frame 0 on the calling thread, for a job of so many samples per pixel. The random
/// numbers are keyed as in Renderer::RenderPass, so the result is the same in every run. settings.plan is not
/// read: everything is modelled.
/// Errors: those of render::MakeCamera and render::EmbreeScene::Create.
absl::StatusOr<Probe> RunProbe(const scene::Scene& scene, const render::RenderSettings& settings,
                               int32_t samples_per_pixel);

}  // namespace lumifold::plan
