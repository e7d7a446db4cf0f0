#include "worker/units/job_scene.h"

#include <map>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
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

/// Without the environment.
render::RenderSettings SettingsOf(const v1::JobSpec& spec, DecodedCache* decoded) {
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
  settings.lens = {spec.lens().f_stop(), spec.lens().focus_metres()};
  settings.mips = [decoded](const scene::SharedImage& image, bool srgb) {
    return decoded->Mips(image, srgb);
  };
  return settings;
}

}  // namespace

absl::Status NamingScene(const absl::Status& status, const v1::JobSpec& spec) {
  return {status.code(), absl::StrCat(spec.scene().display_name(), ": ", status.message())};
}

absl::StatusOr<JobScene> LoadJobScene(const v1::JobSpec& spec, int frame, FetchAsset fetch,
                                      DecodedCache* decoded, std::atomic<int64_t>* progress) {
  Dependencies dependencies;
  for (const v1::AssetRef& asset : spec.scene().dependencies()) dependencies[asset.uri()] = asset;
  absl::StatusOr<std::string> file = fetch(spec.scene().file());
  if (!file.ok()) return file.status();
  const auto read = [&](const std::string& uri) -> absl::StatusOr<std::string> {
    ++*progress;
    const auto asset = dependencies.find(uri);
    if (asset == dependencies.end())
      return absl::NotFoundError(absl::StrCat("'", uri, "' is not among the job's files"));
    return fetch(asset->second);
  };
  scene::LoadOptions options;
  options.time_seconds = SecondsOf(spec, frame);
  options.decode = [decoded](std::string_view bytes, int64_t max_pixels) {
    return decoded->Texture(bytes, max_pixels);
  };
  absl::StatusOr<scene::Scene> scene = scene::LoadGltf(*file, spec.scene().display_name(), read, options);
  if (!scene.ok()) return scene.status();
  file->clear();
  file->shrink_to_fit();
  JobScene job = {std::make_shared<scene::Scene>(*std::move(scene)), SettingsOf(spec, decoded)};
  if (spec.has_environment()) {
    const auto sky_file = dependencies.find(spec.environment().uri());
    absl::StatusOr<std::shared_ptr<const render::Environment>> sky = decoded->Environment(
        spec.environment(), sky_file == dependencies.end() ? "" : sky_file->second.sha256(), read);
    if (!sky.ok()) return sky.status();
    job.settings.environment = *std::move(sky);
  }
  return job;
}

}  // namespace lumifold::worker
