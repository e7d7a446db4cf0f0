#include "worker/plan/probe.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "filter/image/color.h"
#include "worker/render/geometry/camera_packet.h"
#include "worker/render/tracing/embree_scene.h"
#include "worker/render/tracing/path_tracer.h"
#include "worker/render/tracing/processor.h"

namespace lumifold::plan {
namespace {

using render::Vec3;

/// What a pixel's squared error is divided by. Dark pixels count by their share of the frame's light, as in
/// relMSE.
double SquaredLight(double of_pixel, double of_frame) {
  constexpr double kFloor = 0.01;
  return of_pixel * of_pixel + kFloor * of_frame * of_frame;
}

double LuminanceOf(Vec3 c) { return static_cast<double>(Luminance(c.x, c.y, c.z)); }

/// Mean and variance of numbers that come one by one. Source: Welford 1962.
struct Moments {
  int64_t count = 0;
  double mean = 0;
  double squares = 0;  // sum of squared differences from the mean

  void Add(double value) {
    ++count;
    const double before = value - mean;
    mean += before / static_cast<double>(count);
    squares += before * (value - mean);
  }
  double Variance() const { return count < 2 ? 0.0 : squares / static_cast<double>(count); }
};

/// Luminance by depth of level in one block of pixels.
struct BlockLight {
  double all = 0;
  std::array<double, layers::kMaxDepth + 1> at_depth = {};

  void Add(const render::LayerSample& sample) {
    all += LuminanceOf(sample.combined);
    sample.levels.ForEach([&](layers::Level level, const render::LevelSample& s) {
      at_depth[static_cast<size_t>(level.depth)] +=
          LuminanceOf((s.direct + s.indirect) * s.albedo + s.emitted);
    });
  }
};

/// Size of a picture of that aspect ratio with at most so many pixels, but for rounding.
std::pair<int, int> SizeWith(int width, int height, int wanted) {
  const double scale = std::min(1.0, std::sqrt(wanted / (static_cast<double>(width) * height)));
  // An edge of at least one pixel, and what the other one leaves.
  const auto scaled = [scale, wanted](int edge, int other) {
    const int most = std::max(1, wanted / std::max(1, static_cast<int>(std::lround(other * scale))));
    return std::clamp(static_cast<int>(std::lround(edge * scale)), 1, std::min(edge, most));
  };
  return {scaled(width, height), scaled(height, width)};
}

/// Pixels of the probe's picture.
int PixelsOf(const render::RenderSettings& settings, int32_t samples_per_pixel) {
  const double samples = static_cast<double>(settings.width) * settings.height * samples_per_pixel;
  const double affordable = samples / (kSamplesPerProbeSample * double{kProbeSamples});
  return static_cast<int>(std::clamp<double>(affordable, kLeastProbePixels, kProbePixels));
}

/// The settings of the same picture with fewer pixels.
render::RenderSettings Reduced(const render::RenderSettings& settings, int pixels) {
  render::RenderSettings small = settings;
  std::tie(small.width, small.height) = SizeWith(settings.width, settings.height, pixels);
  const auto reduced_x = [&](int x) { return static_cast<int>(int64_t{x} * small.width / settings.width); };
  const auto reduced_y = [&](int y) { return static_cast<int>(int64_t{y} * small.height / settings.height); };
  small.frame = {reduced_x(settings.frame.frame_width), reduced_y(settings.frame.frame_height),
                 reduced_x(settings.frame.x), reduced_y(settings.frame.y)};
  return small;
}

/// Everything is modelled; where all surfaces are diffuse, code for them traces the same bits sooner.
constexpr render::TracingPlan kProbePlan = {.diffuse_code = true, .layers = {}};

/// One probe.
class ProbeRun {
 public:
  ProbeRun(const render::PathTracer& tracer, const render::PictureCamera& camera,
           const render::RenderSettings& picture)
      : tracer_(tracer), camera_(camera), seed_(picture.seed) {
    probe_.width = picture.width;
    probe_.height = picture.height;
    probe_.rays_of_pixel.reserve(static_cast<size_t>(picture.width) * static_cast<size_t>(picture.height));
  }

  Probe Run() {
    const render::ScopedFloatEnvironment environment;
    std::vector<BlockLight> blocks;
    const int columns = (probe_.width + kBlock - 1) / kBlock;
    for (int y = 0; y < probe_.height; ++y) {
      if (y % kBlock == 0) blocks.assign(static_cast<size_t>(columns), {});
      for (int x = 0; x < probe_.width; ++x) TracePixel(x, y, &blocks[static_cast<size_t>(x / kBlock)]);
      if ((y + 1) % kBlock == 0 || y + 1 == probe_.height) AddShares(blocks);
    }
    Finish();
    return std::move(probe_);
  }

 private:
  void TracePixel(int x, int y, BlockLight* block) {
    const int64_t rays_before = render::RaysOfThread();
    Moments luminance;
    std::array<render::LayerSample, render::PathTracer::kPacket> samples;
    const auto trace = [&](const render::CameraPacket& packet) {
      tracer_.Trace(packet.rays(), packet.samplers(), samples);
      for (size_t i = 0; i < packet.size(); ++i) {
        ++probe_.samples;
        if (!render::IsFinite(samples[i])) continue;
        luminance.Add(LuminanceOf(samples[i].combined));
        block->Add(samples[i]);
      }
    };
    render::ForEachCameraPacket(camera_, seed_, /*frame=*/0, x, y, {0, kProbeSamples}, trace);
    pixels_.push_back(luminance);
    probe_.rays_of_pixel.push_back(static_cast<float>(render::RaysOfThread() - rays_before) / kProbeSamples);
  }

  void AddShares(const std::vector<BlockLight>& blocks) {
    for (const BlockLight& block : blocks) {
      if (block.all <= 0) continue;
      double deeper = 0;
      for (size_t depth = layers::kMaxDepth; depth > 0; --depth) {
        deeper += block.at_depth[depth];
        probe_.level_share[depth] = std::max(probe_.level_share[depth], deeper / block.all);
      }
    }
  }

  void Finish() {
    double mean = 0;
    for (const Moments& pixel : pixels_) mean += pixel.mean;
    mean /= static_cast<double>(pixels_.size());
    if (!(mean > 0)) return;
    for (const Moments& pixel : pixels_) probe_.noise += pixel.Variance() / SquaredLight(pixel.mean, mean);
    probe_.noise /= static_cast<double>(pixels_.size());
  }

  const render::PathTracer& tracer_;
  const render::PictureCamera& camera_;
  uint64_t seed_;
  Probe probe_;
  std::vector<Moments> pixels_;
};

}  // namespace

double Probe::RaysPerSample(const Rect& rect, int frame_width, int frame_height) const {
  // The first and one past the last pixel of the probe that [from, to) covers; at least one.
  const auto covered = [](int from, int to, int frame, int edge) {
    const auto first = static_cast<int>(int64_t{from} * edge / frame);
    const auto last = static_cast<int>((int64_t{to} * edge + frame - 1) / frame);
    return std::pair{first, std::max(last, first + 1)};
  };
  const auto [x0, x1] = covered(rect.x0, rect.x1, frame_width, width);
  const auto [y0, y1] = covered(rect.y0, rect.y1, frame_height, height);
  double sum = 0;
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x)
      sum += static_cast<double>(
          rays_of_pixel[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)]);
  }
  return sum / (static_cast<double>(x1 - x0) * (y1 - y0));
}

absl::StatusOr<Probe> RunProbe(const scene::Scene& scene, const render::RenderSettings& settings,
                               int32_t samples_per_pixel) {
  const render::RenderSettings picture = Reduced(settings, PixelsOf(settings, samples_per_pixel));
  const absl::StatusOr<render::PictureCamera> camera = render::MakeCamera(scene, picture);
  if (!camera.ok()) return camera.status();
  const absl::StatusOr<std::unique_ptr<render::EmbreeScene>> embree =
      render::EmbreeScene::Create(scene, render::OpacityClassOf, settings.builders);
  if (!embree.ok()) return embree.status();
  const render::PathTracer tracer(scene, **embree, settings.environment, settings.max_bounces, settings.mips,
                                  kProbePlan);
  const int64_t rays_before = render::RaysOfThread();
  Probe probe = ProbeRun(tracer, *camera, picture).Run();
  probe.rays = render::RaysOfThread() - rays_before;
  return probe;
}

}  // namespace lumifold::plan
