#include "worker/render/renderer.h"

#include <cmath>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "render_sources.h"
#include "worker/render/geometry/fragments.h"
#include "worker/render/geometry/geometry_unit.h"
#include "worker/render/sample_batch.h"
#include "worker/render/tracing/pass_sums.h"
#include "worker/render/tracing/processor.h"

namespace lumifold::render {
namespace {

/// The error message for a lens that does not fit this camera; empty if it fits.
std::string LensError(const Lens& lens, const scene::Camera& camera) {
  if (lens.f_stop == 0) return "";
  if (!(lens.f_stop > 0 && std::isfinite(lens.f_stop))) return "the f-stop is no positive number";
  if (!(lens.focus_metres > 0 && std::isfinite(lens.focus_metres)))
    return "the distance of focus is no positive number";
  if (camera.kind != scene::Camera::Kind::kPerspective)
    return absl::StrCat("the camera '", camera.name, "' is orthographic and has no lens to focus");
  return "";
}

OpacitySource OpacitySourceOf(const scene::Scene& scene, const TracingPlan& plan) {
  if (!plan.opacity_scan) return OpacityClassOf;
  return [ranges = std::make_shared<TextureRanges>(scene)](const scene::Scene& s, const scene::Mesh& mesh) {
    return ScannedOpacityClassOf(s, mesh, ranges.get());
  };
}

bool HasAbsorbingSolid(const scene::Scene& scene) {
  return std::any_of(scene.materials.begin(), scene.materials.end(), [](const scene::Material& material) {
    return material.volume.is_solid && material.volume.attenuation_distance > 0;
  });
}

/// Whether something is seen without light.
bool ShowsUnlit(const scene::Scene& scene) {
  return std::any_of(scene.instances.begin(), scene.instances.end(), [&](const scene::Instance& instance) {
    const int material = scene.meshes[instance.mesh].material;
    return material != scene::kNone && scene.materials[material].unlit;
  });
}

}  // namespace

absl::StatusOr<PictureCamera> MakeCamera(const scene::Scene& scene, const RenderSettings& settings) {
  const bool is_whole = settings.frame.frame_width == 0;
  const FrameWindow frame = is_whole ? FrameWindow{settings.width, settings.height} : settings.frame;
  const float aspect = static_cast<float>(frame.frame_width) / static_cast<float>(frame.frame_height);
  const absl::StatusOr<scene::Camera> camera = FindCamera(scene, settings.camera, aspect);
  if (!camera.ok()) return camera.status();
  if (const std::string error = LensError(settings.lens, *camera); !error.empty())
    return absl::InvalidArgumentError(error);
  return PictureCamera(*camera, settings.lens, frame, settings.pixel_filter);
}

std::string NumericClass(const std::string& other_bits) {
  return absl::StrCat("lumifold-", LUMIFOLD_VERSION, "/", EmbreeName(), "-", TracingInstructionSet(), "-",
                      kRenderSources, other_bits.empty() ? "" : "+", other_bits, "-",
                      absl::Hex(ApproximationsOfProcessor(), absl::kZeroPad4));
}

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::Create(std::shared_ptr<const scene::Scene> scene,
                                                           const RenderSettings& settings) {
  const absl::StatusOr<PictureCamera> camera = MakeCamera(*scene, settings);
  if (!camera.ok()) return camera.status();
  absl::StatusOr<std::unique_ptr<EmbreeScene>> embree =
      EmbreeScene::Create(*scene, OpacitySourceOf(*scene, settings.plan), settings.builders);
  if (!embree.ok()) return embree.status();
  absl::StatusOr<std::unique_ptr<ShadowCatchers>> catchers = ShadowCatchers::Create(*scene);
  if (!catchers.ok()) return catchers.status();
  return std::unique_ptr<Renderer>(new Renderer(std::move(scene), *std::move(embree), *std::move(catchers),
                                                *camera, settings));  // the constructor is private
}

Renderer::Renderer(std::shared_ptr<const scene::Scene> scene, std::unique_ptr<EmbreeScene> embree,
                   std::unique_ptr<ShadowCatchers> catchers, const PictureCamera& camera,
                   const RenderSettings& settings)
    : scene_(std::move(scene)),
      embree_(std::move(embree)),
      catchers_(std::move(catchers)),
      settings_(settings),
      camera_(camera),
      tracer_(*scene_, *embree_, settings.environment, settings.max_bounces, settings.mips, settings.plan,
              {settings.is_transparent, catchers_.get()}),
      warnings_(scene_->warnings) {
  settings_.plan.layers.lens = camera_.HasLens();
  if (HasAbsorbingSolid(*scene_) && camera_.Viewpoint().has_value()) tracer_.SetCamera(*camera_.Viewpoint());
  if (!tracer_.HasLights() && !ShowsUnlit(*scene_))
    warnings_.emplace_back("the scene has no light: the picture is black");
  if (settings.environment != nullptr && settings.environment->bad_texels() > 0) {
    warnings_.push_back(
        absl::StrCat(settings.environment->bad_texels(),
                     " pixels of the environment are negative or not finite: taken as black"));
  }
}

std::shared_ptr<const EdgeMask> Renderer::EdgePixelsOf(const Rect& rect,
                                                       const std::atomic<bool>* stop) const {
  if (std::shared_ptr<const EdgeMask> kept = masks_.Find(rect); kept != nullptr) return kept;
  auto mask = std::make_shared<const EdgeMask>(FindEdgePixels(tracer_, camera_, FrameRect(), rect, stop));
  KeepIfComplete(mask, stop);
  return mask;
}

void Renderer::KeepIfComplete(std::shared_ptr<const EdgeMask> mask, const std::atomic<bool>* stop) const {
  if (stop == nullptr || !stop->load(std::memory_order_relaxed)) masks_.Keep(std::move(mask));
}

EdgedImage Renderer::RenderPass(const Rect& rect, int frame, const TileSamples& tile_samples,
                                RenderCounts* counts) const {
  const ScopedFloatEnvironment environment;
  PassPicture picture(rect.width(), rect.height(), settings_.plan.layers, settings_.is_transparent);
  FragmentRows fragments(settings_.plan.layers);
  const std::shared_ptr<const EdgeMask> edges =
      fragments.IsCarried() ? EdgePixelsOf(rect, counts->stop) : std::make_shared<const EdgeMask>(rect);
  SampleBatch batch(tracer_, stream_packets_, {rect, edges.get(), &picture, &fragments, counts});
  const int64_t rays_before = RaysOfThread();
  for (int y = rect.y0; y < rect.y1; ++y) {
    for (int x = rect.x0; x < rect.x1 && !counts->IsStopped(); ++x)
      batch.Add(camera_, settings_.seed, frame, x, y, tile_samples.At(x - rect.x0, y - rect.y0));
    batch.EndRow();
  }
  batch.Trace();
  counts->rays += RaysOfThread() - rays_before;
  return {picture.Take(), {}, fragments.Make()};
}

EdgedImage Renderer::RenderGeometry(const Rect& rect, int, const std::atomic<bool>* stop) const {
  const ScopedFloatEnvironment environment;
  GeometryUnit unit = RenderGeometryUnit(tracer_, camera_, FrameRect(), rect, stop);
  KeepIfComplete(std::make_shared<const EdgeMask>(std::move(unit.mask)), stop);
  return std::move(unit.image);
}

}  // namespace lumifold::render
