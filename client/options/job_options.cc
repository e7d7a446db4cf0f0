#include "client/options/job_options.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "client/reports/job_settings.h"
#include "client/scene/camera_aspect.h"
#include "filter/image/decisions.h"
#include "filter/image/studio.h"
#include "proto/rpc/bounded_text.h"

namespace lumifold::client {
namespace {

constexpr int kMaxBounces = 1024;
constexpr int kMaxMb = 1 << 20;  // a coordinator takes no larger asset

/// Neither kNoEnvironment nor kStudioUri is a file: a file of that name has a folder before it ("./none").
bool HasEnvironment(const EnvironmentMapOptions& environment) {
  return !environment.path.empty() && environment.path != kNoEnvironment;
}

bool HasEnvironmentFile(const EnvironmentMapOptions& environment) {
  return HasEnvironment(environment) && environment.path != kStudioUri;
}

/// URI of the environment map in the job; no file of a scene can have this scheme.
std::string EnvironmentUri(const std::string& path) {
  if (path == kStudioUri) return path;
  return kEnvironmentScheme + rpc::AsUtf8(std::filesystem::path(path).filename().string());
}

constexpr int kDefaultSamples = 64;

constexpr float kMaxPixelFilterWidth = 8;

std::vector<std::string> FilterNames() {
  std::vector<std::string> names;
  names.reserve(kPixelFilters.size());
  for (const PixelFilterChoice& choice : kPixelFilters) names.emplace_back(choice.name);
  return names;
}

v1::PixelFilter PixelFilterOf(const ViewOptions& options) {
  const auto* const choice =
      std::find_if(kPixelFilters.begin(), kPixelFilters.end(),
                   [&](const PixelFilterChoice& c) { return options.pixel_filter == c.name; });
  v1::PixelFilter filter;
  filter.set_kind(choice->kind);
  filter.set_width(options.pixel_filter_width > 0 ? options.pixel_filter_width : choice->width);
  return filter;
}

/// Whether samples are placed in the pixel alone: what a spec without a filter says.
bool IsPixel(const v1::PixelFilter& filter) {
  return filter.kind() == v1::PIXEL_FILTER_KIND_BOX && filter.width() == 1;
}

/// Sets the height of a size that has only a width.
absl::Status CompleteSize(JobOptions* options) {
  PictureSize& size = options->view.size;
  if (size.height > 0) return absl::OkStatus();
  const absl::StatusOr<std::optional<double>> aspect = CameraAspect(options->scene, options->view.camera);
  if (!aspect.ok()) return aspect.status();
  const PictureSize plain;  // of which a camera without aspect ratio takes the shape
  const double height = size.width / aspect->value_or(static_cast<double>(plain.width) / plain.height);
  if (!(height < kMaxEdge + 0.5))
    return absl::InvalidArgumentError(absl::StrCat("--size: at the camera's aspect ratio a picture ",
                                                   size.width, " pixels wide would be higher than ",
                                                   kMaxEdge));
  size.height = std::max(1, static_cast<int>(std::lround(height)));
  return absl::OkStatus();
}

/// The picture is the region.
void SetRegion(const ViewOptions& options, v1::JobSpec* spec) {
  if (!options.region.has_value()) return;
  spec->set_width(options.region->width());
  spec->set_height(options.region->height());
  v1::Crop* const crop = spec->mutable_crop();
  crop->set_frame_width(options.size.width);
  crop->set_frame_height(options.size.height);
  crop->set_x(options.region->x0);
  crop->set_y(options.region->y0);
}

/// What --target-error, --time and --schedule ask for; nothing without them.
absl::StatusOr<v1::AdaptiveSampling> AdaptiveOf(const JobOptions& options) {
  v1::AdaptiveSampling adaptive;
  adaptive.set_target_error(options.sampling.target_error);
  adaptive.set_metric(options.sampling.target_metric == kRelMse ? v1::ERROR_METRIC_REL_MSE
                                                                : v1::ERROR_METRIC_MSE255);
  if (!options.sampling.time.empty()) {
    absl::Duration time;
    if (!absl::ParseDuration(options.sampling.time, &time) || time <= absl::ZeroDuration() ||
        time == absl::InfiniteDuration())
      return absl::InvalidArgumentError(absl::StrCat(
          "--time: expected a duration such as 90s, 10m or 1h30m; got '", options.sampling.time, "'"));
    adaptive.set_time_seconds(absl::ToDoubleSeconds(time));
  }
  for (const absl::string_view text : absl::StrSplit(options.sampling.schedule, ',', absl::SkipEmpty())) {
    double budget = 0;
    if (!absl::SimpleAtod(text, &budget) || !(budget >= 1 && budget <= kMaxSamples))
      return absl::InvalidArgumentError(
          absl::StrCat("--schedule: expected samples per pixel of 1 to ", kMaxSamples, "; got '", text, "'"));
    adaptive.add_schedule(budget);
  }
  if (!options.sampling.time.empty() && !options.sampling.schedule.empty())
    return absl::InvalidArgumentError("--time and --schedule take each other's place");
  if (!options.sampling.schedule.empty() && !options.view.frames.IsOne())
    return absl::InvalidArgumentError("--schedule is of one frame: submit each frame as a job of its own");
  return adaptive;
}

void AddSamplingOptions(CommandLine& command_line, SamplingOptions* options) {
  command_line.AddWholeNumber("--spp", &options->samples_per_pixel, 1, kMaxSamples,
                              "Samples per pixel (default 64); with --adaptive their mean, at most "
                              "(default 4096 with --target-error or --time)");
  command_line.AddFlag("--adaptive", &options->adaptive,
                       "Put the samples where the filtered picture still errs");
  command_line.AddPositiveNumber("--target-error", &options->target_error,
                                 "Implies --adaptive; ends when the estimated error is at most this");
  command_line.AddText("--target-metric", "METRIC", &options->target_metric,
                       "Of --target-error: mse255 (default) or relmse");
  command_line.AddText("--time", "DURATION", &options->time,
                       "Implies --adaptive; render time of all frames to aim at, such as 90s, 10m or 1h30m");
  command_line.AddText("--schedule", "N,N,...", &options->schedule,
                       "In place of --time: lumifold.schedule of its picture gives the same picture");
  command_line.AddSeed("--seed", &options->seed, "Seed of the random numbers (default 0)");
  command_line.AddWholeNumber("--max-bounces", &options->max_bounces, 0, kMaxBounces,
                              "Scattering events after the first surface, at most (default 8)");
}

void AddBackdropOptions(CommandLine& command_line, BackdropOptions* options) {
  command_line.AddChoice("--background", "WHICH", {"environment", kTransparent}, &options->background,
                         "What is seen behind the scene: environment (default), or transparent, with A");
  command_line.AddChoice("--ground", "WHICH", {"none", kShadow}, &options->ground,
                         "Below the scene: none (default), or shadow: a plane of which A has the shadow; "
                         "implies --background transparent");
}

std::optional<ExitCode> CheckCombinations(const JobOptions& options, const std::string& command,
                                          const Environment& environment) {
  const auto report = [&](const char* message) { return ReportUsage(environment, command, message); };
  if (options.sampling.target_metric != kMse255 && options.sampling.target_metric != kRelMse)
    return report("--target-metric must be mse255 or relmse");
  if (options.sampling.target_metric != kMse255 && options.sampling.target_error == 0)
    return report("--target-metric requires --target-error");
  if (const absl::Status limits = AdaptiveOf(options).status(); !limits.ok())
    return ReportUsage(environment, command, std::string(limits.message()));
  if (options.view.pixel_filter_width > kMaxPixelFilterWidth)
    return ReportUsage(environment, command,
                       absl::StrCat("--pixel-filter-width: at most ", kMaxPixelFilterWidth));
  if (options.view.region.has_value() && (options.view.region->x1 > options.view.size.width ||
                                          options.view.region->y1 > options.view.size.height))
    return ReportUsage(environment, command,
                       absl::StrCat("--region: not within the frame of ", options.view.size.width, "x",
                                    options.view.size.height));
  if ((options.lens.f_stop > 0) != (options.lens.focus_metres > 0))
    return report("--f-stop and --focus must be given together");
  if (!HasEnvironment(options.environment) &&
      (options.environment.rotate_degrees != 0 || options.environment.scale != 1))
    return report("--env-rotate and --env-scale require --env");
  if (options.planning.mode != "auto" && options.planning.mode != "full") {
    return ReportUsage(environment, command,
                       absl::StrCat("--plan: expected 'auto' or 'full'; got '", options.planning.mode, "'"));
  }
  if (const absl::Status forced = decisions::ParseForced(options.planning.forced).status(); !forced.ok())
    return ReportUsage(environment, command, absl::StrCat("--force: ", std::string(forced.message())));
  return std::nullopt;
}

}  // namespace

void AddJobOptions(CommandLine& command_line, JobOptions* options) {
  command_line.AddArgument("SCENE", &options->scene, "The scene: a glTF 2.0 file, .gltf or .glb");
  command_line.AddText("--job", "FILE", &options->job_file,
                       "Options from a file of YAML or JSON, such as 'spp: 64'; those given here count more");
  command_line.AddSize(
      "--size", &options->view.size,
      "Picture size in pixels (default 1024x768); W alone: as high as the camera's aspect ratio");
  command_line.AddRect("--region", &options->view.region,
                       "Render only these pixels of the frame, from X0,Y0 to before X1,Y1");
  command_line.AddChoice("--pixel-filter", "FILTER", FilterNames(), &options->view.pixel_filter,
                         "What a pixel is a mean of: box (default), gaussian or blackman-harris");
  command_line.AddPositiveNumber(
      "--pixel-filter-width", &options->view.pixel_filter_width,
      "In pixels, at most 8 (default: 1 of a box, 2 of a Gaussian, 1.5 of blackman-harris)");
  AddSamplingOptions(command_line, &options->sampling);
  command_line.AddText("--method", "METHOD", &options->method,
                       "Filter: a method of 'lumifold filter --list-methods' (default 'default')");
  command_line.AddText("--camera", "CAMERA", &options->view.camera,
                       "Camera by name or number, see 'lumifold info' (default: the scene's first)");
  command_line.AddText("--animation", "CLIP", &options->view.animation,
                       "Play only this animation, by name or number (default: all that fit together)");
  command_line.AddText("--variant", "VARIANT", &options->view.variant,
                       "Variant of the materials by name or number (default: none)");
  command_line.AddFrames("--frame,--frames", &options->view.frames,
                         "Frames, such as 7, 1-48 or 1-48,60 (default 0)");
  command_line.AddPositiveNumber("--fps", &options->view.frames_per_second,
                                 "Frames per second: frame N shows the scene at N/X seconds (default 24)");
  command_line.AddText("--env", "FILE", &options->environment.path,
                       "Environment light: a latitude-longitude picture, .exr or .hdr, 'studio' or 'none' "
                       "(default: a neutral studio where the scene has no light)");
  command_line.Offer("--env", [] { return std::vector<std::string>{kStudioUri, kNoEnvironment}; });
  command_line.AddNumber(
      "--env-rotate", &options->environment.rotate_degrees,
      "Rotation of it about the vertical in degrees, counter-clockwise from above (default 0)");
  command_line.AddPositiveNumber("--env-scale", &options->environment.scale,
                                 "Factor on its radiance (default 1)");
  AddBackdropOptions(command_line, &options->backdrop);
  command_line.AddPositiveNumber(
      "--f-stop", &options->lens.f_stop,
      "Depth of field: focal length / aperture diameter (default: pinhole camera)");
  command_line.AddPositiveNumber("--focus", &options->lens.focus_metres,
                                 "Distance of the plane of focus in metres; with --f-stop");
  command_line.AddTexts("--allow-dir", "DIR", &options->files.allowed_folders,
                        "Folder besides the scene's own whose files the scene may name; repeatable");
  command_line.AddWholeNumber("--max-file-mb", &options->files.max_file_mb, 1, kMaxMb,
                              "Limit of a file of the scene in MiB (default 4096)");
  command_line.AddWholeNumber("--max-job-mb", &options->files.max_job_mb, 1, kMaxMb,
                              "Limit of all files of the job in MiB (default 65536)");
  command_line.AddFlag("--save-film", &options->result.save_film,
                       "Write every layer that the filter reads into the result");
  command_line.AddFlag("--cryptomatte", &options->result.cryptomatte,
                       "Write Cryptomatte layers of objects and materials into the result");
  command_line.AddText(
      "--plan", "WHICH", &options->planning.mode,
      "'auto': leave out what the scene does not need; 'full': model everything (default auto)");
  command_line.AddTexts("--force", "NAME=VALUE", &options->planning.forced,
                        "Override a decision of the plan; repeatable");
}

std::optional<ExitCode> CheckJobOptions(const std::string& command, const Environment& environment,
                                        JobOptions* options) {
  if (const absl::Status sized = CompleteSize(options); !sized.ok()) return ReportError(environment, sized);
  return CheckCombinations(*options, command, environment);
}

absl::StatusOr<SceneAssets> FindJobAssets(const JobOptions& options) {
  const SceneFileRules rules = {
      .allowed_folders = options.files.allowed_folders,
      .max_file_bytes = static_cast<uint64_t>(options.files.max_file_mb) << 20,
      .max_job_bytes = static_cast<uint64_t>(options.files.max_job_mb) << 20,
  };
  absl::StatusOr<SceneAssets> assets = FindSceneAssets(options.scene, rules);
  if (!assets.ok()) return assets;
  if (HasEnvironmentFile(options.environment)) {
    LocalAsset asset;
    asset.path = options.environment.path;
    asset.ref.set_uri(EnvironmentUri(options.environment.path));
    assets->push_back(std::move(asset));
  }
  if (absl::Status status = HashAssets(rules, &*assets); !status.ok()) return status;
  return assets;
}

v1::JobSpec MakeJobSpec(const JobOptions& options) {
  v1::JobSpec spec;
  spec.set_camera(options.view.camera);
  spec.set_animation(options.view.animation);
  spec.set_variant(options.view.variant);
  spec.set_width(options.view.size.width);
  spec.set_height(options.view.size.height);
  SetRegion(options.view, &spec);
  if (const v1::PixelFilter filter = PixelFilterOf(options.view); !IsPixel(filter))
    *spec.mutable_pixel_filter() = filter;
  spec.set_first_frame(options.view.frames.first());
  spec.set_frame_count(options.view.frames.ranges.front().count());
  for (size_t i = 1; i < options.view.frames.ranges.size(); ++i) {
    v1::FrameRange* range = spec.add_more_frames();
    range->set_first(options.view.frames.ranges[i].first);
    range->set_count(options.view.frames.ranges[i].count());
  }
  spec.set_frames_per_second(options.view.frames_per_second);
  const v1::AdaptiveSampling adaptive = AdaptiveOf(options).value();
  const bool has_limit =
      adaptive.target_error() > 0 || adaptive.time_seconds() > 0 || !adaptive.schedule().empty();
  if (options.sampling.adaptive || has_limit) *spec.mutable_adaptive() = adaptive;
  spec.set_samples_per_pixel(options.sampling.samples_per_pixel > 0 ? options.sampling.samples_per_pixel
                             : has_limit                            ? kMostSamplesByDefault
                                                                    : kDefaultSamples);
  spec.set_seed(options.sampling.seed);
  spec.set_max_bounces(options.sampling.max_bounces);
  spec.mutable_filter()->set_method(options.method);
  spec.set_save_film(options.result.save_film);
  spec.set_cryptomatte(options.result.cryptomatte);
  spec.mutable_planning()->set_mode(options.planning.mode == "full" ? v1::PLAN_MODE_FULL
                                                                    : v1::PLAN_MODE_AUTO);
  for (const std::string& forced : options.planning.forced) spec.mutable_planning()->add_forced(forced);
  spec.set_keep_dark(options.environment.path == kNoEnvironment);
  if (HasEnvironment(options.environment)) {
    spec.mutable_environment()->set_uri(EnvironmentUri(options.environment.path));
    spec.mutable_environment()->set_rotate_degrees(options.environment.rotate_degrees);
    spec.mutable_environment()->set_scale(options.environment.scale);
  }
  const bool has_ground = options.backdrop.ground == kShadow;
  if (has_ground) spec.set_ground(v1::GROUND_SHADOW);
  if (has_ground || options.backdrop.background == kTransparent)
    spec.set_background(v1::BACKGROUND_TRANSPARENT);
  if (options.lens.f_stop > 0) {
    spec.mutable_lens()->set_f_stop(options.lens.f_stop);
    spec.mutable_lens()->set_focus_metres(options.lens.focus_metres);
  }
  return spec;
}

}  // namespace lumifold::client
