#include "worker/render/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"
#include "worker/render/camera.h"
#include "worker/render/camera_packet.h"
#include "worker/render/embree_scene.h"
#include "worker/render/floating_point.h"
#include "worker/render/geometry_unit.h"
#include "worker/render/pass_sums.h"
#include "worker/render/path_tracer.h"

namespace lumifold::render {
namespace {

/// What is wrong with a lens for this camera; empty where nothing is.
std::string ProblemOf(const Lens& lens, const scene::Camera& camera) {
  if (lens.f_stop == 0) return "";
  if (!(lens.f_stop > 0 && std::isfinite(lens.f_stop))) return "the f-stop is no positive number";
  if (!(lens.focus_metres > 0 && std::isfinite(lens.focus_metres)))
    return "the distance of focus is no positive number";
  if (camera.kind != scene::Camera::Kind::kPerspective)
    return absl::StrCat("the camera '", camera.name, "' is orthographic and has no lens to focus");
  return "";
}

class RendererImpl final : public Renderer {
 public:
  RendererImpl(std::shared_ptr<const scene::Scene> scene, std::unique_ptr<EmbreeScene> embree,
               const scene::Camera& camera, const RenderSettings& settings)
      : scene_(std::move(scene)),
        embree_(std::move(embree)),
        settings_(settings),
        camera_(camera, settings.lens, settings.width, settings.height),
        tracer_(*scene_, *embree_, settings.environment, settings.max_bounces, settings.light_strategy),
        warnings_(scene_->warnings) {
    if (!tracer_.HasLights()) warnings_.push_back("the scene has no light: the picture is black");
    if (settings.environment != nullptr && settings.environment->bad_texels() > 0) {
      warnings_.push_back(
          absl::StrCat(settings.environment->bad_texels(),
                       " pixels of the environment are negative or not finite: taken as black"));
    }
  }

  LayeredImage RenderPass(const Rect& rect, int frame, SampleRange range,
                          RenderCounts* counts) const override {
    const ScopedFloatEnvironment environment;
    if (settings_.radiance_only) return RenderRadiance(rect, frame, range, counts);
    PassPicture picture(rect.width(), rect.height());
    std::array<LayerSample, PathTracer::kPacket> samples;
    for (int y = rect.y0; y < rect.y1; ++y) {
      for (int x = rect.x0; x < rect.x1; ++x) {
        PixelSums sums;
        ForEachPacket(x, y, frame, range, [&](const CameraPacket& packet) {
          tracer_.Trace(packet.rays(), packet.samplers(), samples);
          for (size_t i = 0; i < packet.size(); ++i) {
            if (Count(IsFinite(samples[i]), counts)) sums.Add(samples[i], packet.Index(i) & 1);
          }
        });
        picture.Store(x - rect.x0, y - rect.y0, sums);
      }
    }
    return picture.Take();
  }

  EdgedImage RenderGeometry(const Rect& rect, int) const override {
    const ScopedFloatEnvironment environment;
    return RenderGeometryUnit(tracer_, camera_, {0, 0, settings_.width, settings_.height}, rect);
  }

  void TraceSamples(const Rect& rect, int frame, SampleRange range, SampleSink* sink) const override {
    const ScopedFloatEnvironment environment;
    std::array<LayerSample, PathTracer::kPacket> samples;
    std::array<GeometrySample, PathTracer::kPacket> geometry;
    for (int y = rect.y0; y < rect.y1; ++y) {
      for (int x = rect.x0; x < rect.x1; ++x) {
        ForEachPacket(x, y, frame, range, [&](const CameraPacket& packet) {
          tracer_.Trace(packet.rays(), packet.samplers(), samples);
          tracer_.TraceGeometry(packet.rays(), geometry);
          for (size_t i = 0; i < packet.size(); ++i) {
            sink->OnSample({PixelNumber(x, y), packet.Index(i), packet.Point(i), packet.LensPoint(i),
                            packet.FirstSurfaceNumbers(i), samples[i], geometry[i]});
          }
        });
      }
    }
  }

  LayeredImage TraceGuide(const Rect& rect, int frame) const override {
    const ScopedFloatEnvironment environment;
    LayeredImage image(rect.width(), rect.height());
    const ColorView direct = image.AddColor(layers::kDirect);
    const ColorView indirect = image.AddColor(layers::kIndirect);
    const std::vector<Sampler> samplers(PathTracer::kPacket, Sampler(settings_.seed, frame, 0, 0));
    std::array<Ray, PathTracer::kPacket> rays;
    std::array<LayerSample, PathTracer::kPacket> samples;
    for (int y = rect.y0; y < rect.y1; ++y) {
      for (int first = rect.x0; first < rect.x1; first += static_cast<int>(PathTracer::kPacket)) {
        const size_t count = std::min(PathTracer::kPacket, static_cast<size_t>(rect.x1 - first));
        for (size_t i = 0; i < count; ++i) rays[i] = CentreRay(first + static_cast<int>(i), y, samplers[i]);
        tracer_.Trace({rays.data(), count}, {samplers.data(), count}, samples);
        for (size_t i = 0; i < count; ++i) {
          if (!IsFinite(samples[i])) continue;
          const int x = first + static_cast<int>(i) - rect.x0;
          Put(direct, x, y - rect.y0, samples[i].direct);
          Put(indirect, x, y - rect.y0, samples[i].indirect);
        }
      }
    }
    return image;
  }

  const PathTracer& tracer() const override { return tracer_; }
  const PictureCamera& camera() const override { return camera_; }

  const std::vector<std::string>& warnings() const override { return warnings_; }

 private:
  Ray CentreRay(int x, int y, const Sampler& sampler) const {
    constexpr Vec2 kMidLens = {0.5f, 0.5f};
    Ray ray = camera_.RayThrough(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, kMidLens);
    ray.chance = sampler.Key(kCameraPair);
    return ray;
  }

  int64_t PixelNumber(int x, int y) const { return static_cast<int64_t>(y) * settings_.width + x; }

  /// Calls visit(CameraPacket) for the samples of a pixel.
  template <typename Visit>
  void ForEachPacket(int x, int y, int frame, SampleRange range, Visit visit) const {
    ForEachCameraPacket(camera_, settings_.seed, frame, settings_.width, x, y, range, visit);
  }

  /// Counts a sample; gives back whether it is good.
  static bool Count(bool is_finite, RenderCounts* counts) {
    ++counts->samples;
    if (!is_finite) ++counts->bad_samples;
    return is_finite;
  }

  LayeredImage RenderRadiance(const Rect& rect, int frame, SampleRange range, RenderCounts* counts) const {
    LayeredImage image(rect.width(), rect.height());
    const std::array<ColorView, 2> halves = {image.AddColor(layers::HalfA(layers::kNoisy)),
                                             image.AddColor(layers::HalfB(layers::kNoisy))};
    const std::array<FloatView, 2> samples = {image.Add(layers::kSamplesA), image.Add(layers::kSamplesB)};
    std::array<Vec3, PathTracer::kPacket> radiances;
    for (int y = rect.y0; y < rect.y1; ++y) {
      for (int x = rect.x0; x < rect.x1; ++x) {
        std::array<Vec3, 2> sums;
        std::array<float, 2> count = {0, 0};
        ForEachPacket(x, y, frame, range, [&](const CameraPacket& packet) {
          tracer_.TraceRadiance(packet.rays(), packet.samplers(), radiances);
          for (size_t i = 0; i < packet.size(); ++i) {
            if (!Count(IsFinite(radiances[i]), counts)) continue;
            sums[packet.Index(i) & 1] += radiances[i];
            count[packet.Index(i) & 1] += 1;
          }
        });
        for (size_t half = 0; half < 2; ++half) {
          Put(halves[half], x - rect.x0, y - rect.y0, sums[half]);
          samples[half].At(x - rect.x0, y - rect.y0) = count[half];
        }
      }
    }
    return image;
  }

  std::shared_ptr<const scene::Scene> scene_;
  std::unique_ptr<EmbreeScene> embree_;
  RenderSettings settings_;
  PictureCamera camera_;
  PathTracer tracer_;
  std::vector<std::string> warnings_;
};

}  // namespace

std::string NumericClass() {
  return absl::StrCat("lumifold-", LUMIFOLD_VERSION, "/", TracingInstructionSet());
}

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::Create(std::shared_ptr<const scene::Scene> scene,
                                                           const RenderSettings& settings) {
  const std::optional<scene::Camera> camera = FindCamera(*scene, settings.camera);
  if (!camera.has_value())
    return absl::NotFoundError(absl::StrCat("the scene has no camera called '", settings.camera, "'"));
  if (const std::string problem = ProblemOf(settings.lens, *camera); !problem.empty())
    return absl::InvalidArgumentError(problem);
  absl::StatusOr<std::unique_ptr<EmbreeScene>> embree = EmbreeScene::Create(*scene);
  if (!embree.ok()) return embree.status();
  return std::make_unique<RendererImpl>(std::move(scene), *std::move(embree), *camera, settings);
}

}  // namespace lumifold::render
