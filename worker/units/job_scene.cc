#include "worker/units/job_scene.h"

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/render/lights/studio.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::worker {
namespace {

using Dependencies = std::map<std::string, v1::AssetRef>;  // by uri

/// Time of a frame in the scene's animations. Jobs recorded by a version without frames_per_second show time
/// 0.
double SecondsOf(const v1::JobSpec& spec, int frame) {
  return spec.frames_per_second() > 0 ? frame / spec.frames_per_second() : 0;
}

render::PixelFilter PixelFilterOf(const v1::PixelFilter& filter) {
  using Kind = render::PixelFilter::Kind;
  switch (filter.kind()) {
    case v1::PIXEL_FILTER_KIND_GAUSSIAN:
      return {Kind::kGaussian, filter.width()};
    case v1::PIXEL_FILTER_KIND_BLACKMAN_HARRIS:
      return {Kind::kBlackmanHarris, filter.width()};
    default:
      return {Kind::kBox, filter.width()};
  }
}

/// Whether anything can be seen without another light.
bool HasLight(const scene::Scene& scene) {
  const auto shines = [&](const scene::Instance& instance) {
    const int number = scene.meshes[instance.mesh].material;
    if (number == scene::kNone) return false;
    const scene::Material& material = scene.materials[number];
    return material.unlit || material.emission.radiance != scene::Vec3{0, 0, 0};
  };
  const auto is_lit = [](const scene::PunctualLight& light) {
    return light.intensity > 0 && light.color != scene::Vec3{0, 0, 0};
  };
  return std::any_of(scene.lights.begin(), scene.lights.end(), is_lit) ||
         std::any_of(scene.instances.begin(), scene.instances.end(), shines);
}

/// Makes the mip levels of all textures side by side, and returns where the renderer finds them.
render::MipSource MakeAllMips(const scene::Scene& scene, DecodedCache* decoded, TaskPool* pool) {
  using Key = std::pair<const scene::ImageData*, bool>;  // and whether it is sRGB
  std::map<Key, render::SharedMips> mips;
  std::vector<std::pair<scene::SharedImage, bool>> wanted;
  for (const scene::Material& material : scene.materials) {
    for (const scene::TextureUse& use : TexturesOf(material)) {
      if (use.ref->texture == scene::kNone) continue;
      const int image = scene.textures[use.ref->texture].image;
      if (image != scene::kNone && mips.try_emplace({scene.images[image].get(), use.srgb}).second)
        wanted.emplace_back(scene.images[image], use.srgb);
    }
  }
  std::vector<render::SharedMips> made(wanted.size());
  ParallelFor(pool, static_cast<int64_t>(wanted.size()),
              [&](int64_t i) { made[i] = decoded->Mips(wanted[i].first, wanted[i].second); });
  for (size_t i = 0; i < wanted.size(); ++i) mips[{wanted[i].first.get(), wanted[i].second}] = made[i];
  return [mips = std::move(mips)](const scene::SharedImage& image, bool srgb) {
    return mips.at({image.get(), srgb});
  };
}

Dependencies DependenciesOf(const v1::JobSpec& spec) {
  Dependencies dependencies;
  for (const v1::AssetRef& asset : spec.scene().dependencies()) dependencies[asset.uri()] = asset;
  return dependencies;
}

absl::StatusOr<std::string> FetchFile(const std::string& uri, const Dependencies& dependencies,
                                      FetchAsset fetch) {
  const auto asset = dependencies.find(uri);
  if (asset == dependencies.end())
    return absl::NotFoundError(absl::StrCat("'", uri, "' is not among the job's files"));
  const absl::StatusOr<AssetContent> content = fetch(asset->second);
  if (!content.ok()) return content.status();
  return **content;
}

/// Without a decoder of pictures.
scene::LoadOptions OptionsOf(const v1::JobSpec& spec, int frame, TaskPool* pool) {
  scene::LoadOptions options;
  options.time_seconds = SecondsOf(spec, frame);
  options.animation = spec.animation();
  options.variant = spec.variant();
  options.catches_shadows = spec.background() == v1::BACKGROUND_TRANSPARENT;
  options.pool = pool;
  return options;
}

/// Without the environment.
render::RenderSettings SettingsOf(const v1::JobSpec& spec) {
  render::RenderSettings settings;
  settings.width = spec.width();
  settings.height = spec.height();
  settings.seed = spec.seed();
  settings.max_bounces = spec.max_bounces();
  settings.camera = spec.camera();
  if (spec.has_crop())
    settings.frame = {spec.crop().frame_width(), spec.crop().frame_height(), spec.crop().x(),
                      spec.crop().y()};
  if (spec.has_pixel_filter()) settings.pixel_filter = PixelFilterOf(spec.pixel_filter());
  settings.is_transparent = spec.background() == v1::BACKGROUND_TRANSPARENT;
  settings.lens = {spec.lens().f_stop(), spec.lens().focus_metres()};
  return settings;
}

}  // namespace

absl::Status NamingScene(const absl::Status& status, const v1::JobSpec& spec) {
  return {status.code(), absl::StrCat(spec.scene().display_name(), ": ", status.message())};
}

absl::Status CheckJobScene(const v1::JobSpec& spec, int frame, FetchAsset fetch, TaskPool* pool) {
  const Dependencies dependencies = DependenciesOf(spec);
  const absl::StatusOr<AssetContent> file = fetch(spec.scene().file());
  if (!file.ok()) return file.status();
  scene::LoadOptions options = OptionsOf(spec, frame, pool);
  options.decode = [](std::string_view, int64_t) {
    return std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {0, 0, 0, 0}});
  };
  const auto read = [&](const std::string& uri) { return FetchFile(uri, dependencies, fetch); };
  const absl::StatusOr<scene::Scene> scene =
      scene::LoadGltf(**file, spec.scene().display_name(), read, options);
  if (!scene.ok()) return scene.status();
  const absl::Status camera = render::MakeCamera(*scene, SettingsOf(spec)).status();
  return camera.ok() ? camera : NamingScene(camera, spec);
}

absl::StatusOr<JobScene> LoadJobScene(const v1::JobSpec& spec, int frame, FetchAsset fetch,
                                      DecodedCache* decoded, TaskPool* pool, std::atomic<int64_t>* progress) {
  const Dependencies dependencies = DependenciesOf(spec);
  absl::StatusOr<AssetContent> file = fetch(spec.scene().file());
  if (!file.ok()) return file.status();
  const auto read = [&](const std::string& uri) {
    ++*progress;
    return FetchFile(uri, dependencies, fetch);
  };
  scene::LoadOptions options = OptionsOf(spec, frame, pool);
  options.decode = [decoded](std::string_view bytes, int64_t max_pixels) {
    return decoded->Texture(bytes, max_pixels);
  };
  absl::StatusOr<scene::Scene> scene = scene::LoadGltf(**file, spec.scene().display_name(), read, options);
  if (!scene.ok()) return scene.status();
  file->reset();  // before the trees take memory
  if (spec.ground() == v1::GROUND_SHADOW) scene::AddShadowGround(&*scene);
  JobScene job;
  job.scene = std::make_shared<scene::Scene>(*std::move(scene));
  job.settings = SettingsOf(spec);
  job.settings.mips = MakeAllMips(*job.scene, decoded, pool);
  job.settings.builders = pool;
  if (spec.has_environment()) {
    const auto sky_file = dependencies.find(spec.environment().uri());
    absl::StatusOr<std::shared_ptr<const render::Environment>> sky = decoded->Environment(
        spec.environment(), sky_file == dependencies.end() ? "" : sky_file->second.sha256(), read);
    if (!sky.ok()) return sky.status();
    job.settings.environment = *std::move(sky);
  } else if (!spec.keep_dark() && !HasLight(*job.scene)) {
    job.settings.environment = render::StudioEnvironment();
    job.in_studio = true;
  }
  return job;
}

}  // namespace lumifold::worker
