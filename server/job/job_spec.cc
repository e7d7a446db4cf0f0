#include "server/job/job_spec.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "filter/image/decisions.h"
#include "filter/image/studio.h"
#include "filter/image/tile_samples.h"
#include "server/job/frame_list.h"
#include "server/job/limits.h"
#include "server/job/plan.h"
#include "server/job/tile_grid.h"

namespace lumifold::job {
namespace {

absl::Status CheckRange(const char* field, int64_t value, int64_t low, int64_t high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(field, " is ", value, ", not ", low, " to ", high));
}

absl::Status CheckLength(const std::string& field, const std::string& text, size_t most) {
  if (text.size() <= most) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(field, " has ", text.size(), " bytes, more than ", most));
}

absl::Status CheckTexts(const v1::JobSpec& spec) {
  for (const absl::Status& status : {
           CheckLength("camera", spec.camera(), kMaxNameBytes),
           CheckLength("animation", spec.animation(), kMaxNameBytes),
           CheckLength("variant", spec.variant(), kMaxNameBytes),
           CheckLength("scene.display_name", spec.scene().display_name(), kMaxNameBytes),
           CheckLength("filter.method", spec.filter().method(), kMaxNameBytes),
           CheckLength("environment.uri", spec.environment().uri(), kMaxUriBytes),
           CheckLength("scene.file.uri", spec.scene().file().uri(), kMaxUriBytes),
       }) {
    if (!status.ok()) return status;
  }
  const auto& dependencies = spec.scene().dependencies();
  if (absl::Status status =
          CheckRange("the number of scene.dependencies", dependencies.size(), 0, kMaxDependencies);
      !status.ok()) {
    return status;
  }
  for (int i = 0; i < dependencies.size(); ++i) {
    if (dependencies[i].uri().size() > kMaxUriBytes)
      return CheckLength(absl::StrCat("scene.dependencies[", i, "].uri"), dependencies[i].uri(),
                         kMaxUriBytes);
  }
  const size_t most = NeedsPlan(spec) ? kMaxSpecBytes - kMaxPlanBytes : kMaxSpecBytes;
  if (spec.ByteSizeLong() <= most) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("the spec has ", spec.ByteSizeLong(), " bytes, more than ", most));
}

absl::Status CheckSize(const std::string& field, const v1::AssetRef& asset) {
  if (asset.size() <= kMaxAssetBytes) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(field, ".size is ", asset.size(), ", more than ", kMaxAssetBytes));
}

absl::Status CheckScene(const v1::SceneRef& scene) {
  if (absl::Status status = CheckSize("scene.file", scene.file()); !status.ok()) return status;
  std::set<std::string> uris;
  for (const v1::AssetRef& asset : scene.dependencies()) {
    const std::string field = absl::StrCat("scene.dependencies '", asset.uri(), "'");
    if (absl::Status status = CheckSize(field, asset); !status.ok()) return status;
    if (asset.uri().empty() || !uris.insert(asset.uri()).second) {
      return absl::InvalidArgumentError(absl::StrCat(field, ": the uri is empty or appears twice"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckPositive(const char* field, double value) {
  if (std::isfinite(value) && value > 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(field, " is ", value, ", not a finite number above 0"));
}

absl::Status CheckEnvironment(const v1::JobSpec& spec) {
  if (!spec.has_environment()) return absl::OkStatus();
  const v1::EnvironmentMap& environment = spec.environment();
  const bool is_file = environment.uri() != kStudioUri;
  const auto& files = spec.scene().dependencies();
  if (is_file && std::none_of(files.begin(), files.end(),
                              [&](const v1::AssetRef& asset) { return asset.uri() == environment.uri(); })) {
    return absl::InvalidArgumentError(
        absl::StrCat("environment.uri '", environment.uri(), "' is not among the scene's dependencies"));
  }
  if (!std::isfinite(environment.rotate_degrees())) {
    return absl::InvalidArgumentError("environment.rotate_degrees is not a finite number");
  }
  return CheckPositive("environment.scale", environment.scale());
}

absl::Status CheckLens(const v1::JobSpec& spec) {
  if (!spec.has_lens()) return absl::OkStatus();
  if (absl::Status status = CheckPositive("lens.f_stop", spec.lens().f_stop()); !status.ok()) return status;
  return CheckPositive("lens.focus_metres", spec.lens().focus_metres());
}

absl::Status CheckCrop(const v1::JobSpec& spec) {
  if (!spec.has_crop()) return absl::OkStatus();
  const v1::Crop& crop = spec.crop();
  for (const absl::Status& status : {
           CheckRange("crop.frame_width", crop.frame_width(), 1, kMaxEdge),
           CheckRange("crop.frame_height", crop.frame_height(), 1, kMaxEdge),
           CheckRange("crop.x", crop.x(), 0, crop.frame_width() - spec.width()),
           CheckRange("crop.y", crop.y(), 0, crop.frame_height() - spec.height()),
       }) {
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status CheckBackground(const v1::JobSpec& spec) {
  if (!v1::Background_IsValid(spec.background()))
    return absl::InvalidArgumentError(
        absl::StrCat("background is ", static_cast<int>(spec.background()), ", which is none"));
  if (!v1::Ground_IsValid(spec.ground()))
    return absl::InvalidArgumentError(
        absl::StrCat("ground is ", static_cast<int>(spec.ground()), ", which is none"));
  if (spec.ground() == v1::GROUND_NONE || spec.background() == v1::BACKGROUND_TRANSPARENT)
    return absl::OkStatus();
  return absl::InvalidArgumentError("ground: a shadow needs a transparent background");
}

absl::Status CheckPixelFilter(const v1::JobSpec& spec) {
  if (!spec.has_pixel_filter()) return absl::OkStatus();
  const v1::PixelFilter& filter = spec.pixel_filter();
  if (!v1::PixelFilterKind_IsValid(filter.kind()))
    return absl::InvalidArgumentError(
        absl::StrCat("pixel_filter.kind is ", static_cast<int>(filter.kind()), ", which is none"));
  if (filter.width() > 0 && filter.width() <= kMaxPixelFilterWidth) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("pixel_filter.width is ", filter.width(),
                                                 ", not above 0 and at most ", kMaxPixelFilterWidth));
}

/// Of a job without a plan both may be 0.
absl::Status CheckUnits(const v1::JobSpec& spec) {
  const bool may_be_planned = NeedsPlan(spec);
  if (!may_be_planned || spec.tile_size() != 0) {
    absl::Status status = CheckRange("tile_size", spec.tile_size(), kMinTileSize, kMaxTileSize);
    if (!status.ok()) return status;
  }
  if (!may_be_planned || spec.pass_samples() != 0) {
    absl::Status status = CheckRange("pass_samples", spec.pass_samples(), 2, kMaxSamples);
    if (!status.ok()) return status;
  }
  absl::Status status = CheckRange("first_pass_samples", spec.first_pass_samples(), 0, spec.pass_samples());
  if (!status.ok()) return status;
  for (const auto& [field, samples] : {std::pair("pass_samples", spec.pass_samples()),
                                       std::pair("first_pass_samples", spec.first_pass_samples())}) {
    if (samples % 2 != 0)
      return absl::InvalidArgumentError(absl::StrCat(field, " is ", samples, ", not even"));
  }
  return absl::OkStatus();
}

absl::Status CheckNumbers(const v1::JobSpec& spec) {
  for (const absl::Status& status : {
           CheckRange("width", spec.width(), 1, kMaxEdge),
           CheckRange("height", spec.height(), 1, kMaxEdge),
           FrameList::Check(spec),
           CheckRange("samples_per_pixel", spec.samples_per_pixel(), 1, kMaxSamples),
           CheckRange("max_bounces", spec.max_bounces(), 0, kMaxBounces),
           CheckUnits(spec),
           CheckPositive("frames_per_second", spec.frames_per_second()),
       }) {
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

/// The limit of time of a job with adaptive sampling, or the schedule in place of it.
absl::Status CheckTime(const v1::JobSpec& spec) {
  const v1::AdaptiveSampling& adaptive = spec.adaptive();
  const double time = adaptive.time_seconds();
  if (!std::isfinite(time) || time < 0)
    return absl::InvalidArgumentError(
        absl::StrCat("adaptive.time_seconds is ", time, ", not a finite number from 0 on"));
  if (adaptive.schedule_size() > kMaxRounds)
    return absl::InvalidArgumentError(absl::StrCat("adaptive.schedule has ", adaptive.schedule_size(),
                                                   " budgets, a frame at most ", kMaxRounds, " rounds"));
  for (const double budget : adaptive.schedule()) {
    if (budget >= 1 && budget <= spec.samples_per_pixel()) continue;
    return absl::InvalidArgumentError(absl::StrCat("adaptive.schedule has ", budget,
                                                   ", not samples per pixel from 1 to samples_per_pixel, ",
                                                   spec.samples_per_pixel()));
  }
  if (time > 0 && !adaptive.schedule().empty())
    return absl::InvalidArgumentError("adaptive has a time and a schedule, which take each other's place");
  if (adaptive.schedule().empty() || FrameList(spec).count() == 1) return absl::OkStatus();
  return absl::InvalidArgumentError("a schedule is of one frame: submit each frame as a job of its own");
}

absl::Status CheckAdaptive(const v1::JobSpec& spec) {
  if (!spec.has_adaptive()) return absl::OkStatus();
  const double target = spec.adaptive().target_error();
  if (!std::isfinite(target) || target < 0)
    return absl::InvalidArgumentError(
        absl::StrCat("adaptive.target_error is ", target, ", not a finite number from 0 on"));
  if (absl::Status status = CheckTime(spec); !status.ok()) return status;
  if (!v1::ErrorMetric_IsValid(spec.adaptive().metric()))
    return absl::InvalidArgumentError(
        absl::StrCat("adaptive.metric is ", spec.adaptive().metric(), ", which is none"));
  if (spec.tile_size() % kSampleBlock != 0) {
    return absl::InvalidArgumentError(absl::StrCat("tile_size is ", spec.tile_size(),
                                                   ", with adaptive sampling it must be a multiple of ",
                                                   kSampleBlock));
  }
  if (int64_t{spec.width()} * spec.height() <= kMaxAdaptivePixels) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "a picture of ", spec.width(), "x", spec.height(),
      " pixels is too large for adaptive sampling, which filters it as a whole: ", kMaxAdaptivePixels,
      " pixels at most"));
}

/// Even, because samples alternate between the halves.
int DefaultPassSamples(int samples_per_pixel) {
  const int share = samples_per_pixel / kDefaultMaxPasses;
  return std::max(kMinDefaultPassSamples, share + share % 2);
}

/// A forced decision that is also a field of the spec: the field gets its value.
absl::Status TakeForced(const char* field, const decisions::Values& forced, std::string_view decision,
                        int32_t current, const std::function<void(int)>& set) {
  const auto found = forced.find(decision);
  if (found == forced.end() || found->second == 0 || found->second == current) return absl::OkStatus();
  if (current != 0) {
    return absl::InvalidArgumentError(absl::StrCat(field, " is ", current, ", but planning.forced has ",
                                                   std::string(decision), "=", found->second));
  }
  set(found->second);
  return absl::OkStatus();
}

/// Checks the forced decisions, and takes over those that are fields of the spec.
absl::Status ApplyForced(v1::JobSpec* spec) {
  const auto& forced = spec->planning().forced();
  if (!v1::PlanMode_IsValid(spec->planning().mode()))
    return absl::InvalidArgumentError(
        absl::StrCat("planning.mode is ", static_cast<int>(spec->planning().mode()), ", not 0 or 1"));
  if (absl::Status status = CheckRange("the number of planning.forced", forced.size(), 0, kMaxForced);
      !status.ok())
    return status;
  for (const std::string& text : forced) {
    if (absl::Status status = CheckLength("planning.forced", text, kMaxForcedBytes); !status.ok())
      return status;
  }
  const absl::StatusOr<decisions::Values> values =
      decisions::ParseForced(std::vector<std::string>(forced.begin(), forced.end()));
  if (!values.ok())
    return absl::InvalidArgumentError(
        absl::StrCat("planning.forced: ", std::string(values.status().message())));
  if (absl::Status status = TakeForced("tile_size", *values, decisions::kTileSize, spec->tile_size(),
                                       [spec](int value) { spec->set_tile_size(value); });
      !status.ok())
    return status;
  const auto passes = values->find(decisions::kPassSamples);
  if (passes != values->end() && passes->second == 0 && spec->pass_samples() == 0)
    SetPassSamples(DefaultPassSamples(spec->samples_per_pixel()), spec);
  return TakeForced("pass_samples", *values, decisions::kPassSamples, spec->pass_samples(),
                    [spec](int value) { SetPassSamples(value, spec); });
}

}  // namespace

void SetPassSamples(int pass_samples, v1::JobSpec* spec) {
  spec->set_pass_samples(pass_samples);
  if (spec->first_pass_samples() == 0 && pass_samples > kFirstPassSamples && !spec->has_adaptive())
    spec->set_first_pass_samples(kFirstPassSamples);
}

absl::StatusOr<v1::JobSpec> NormaliseJobSpec(v1::JobSpec spec) {
  if (absl::Status status = ApplyForced(&spec); !status.ok()) return status;
  if (!NeedsPlan(spec)) {
    if (spec.tile_size() == 0) spec.set_tile_size(kDefaultTileSize);
    if (spec.pass_samples() == 0) SetPassSamples(DefaultPassSamples(spec.samples_per_pixel()), &spec);
  }
  if (spec.frames_per_second() == 0) spec.set_frames_per_second(kDefaultFramesPerSecond);
  if (spec.filter().method().empty()) spec.mutable_filter()->set_method("default");
  if (absl::Status status = CheckNumbers(spec); !status.ok()) return status;
  if (absl::Status status = CheckAdaptive(spec); !status.ok()) return status;
  if (absl::Status status = CheckTexts(spec); !status.ok()) return status;
  if (absl::Status status = CheckScene(spec.scene()); !status.ok()) return status;
  if (absl::Status status = CheckEnvironment(spec); !status.ok()) return status;
  if (absl::Status status = CheckLens(spec); !status.ok()) return status;
  if (absl::Status status = CheckCrop(spec); !status.ok()) return status;
  if (absl::Status status = CheckPixelFilter(spec); !status.ok()) return status;
  if (absl::Status status = CheckBackground(spec); !status.ok()) return status;
  const int64_t samples_per_frame = int64_t{spec.width()} * spec.height() * spec.samples_per_pixel();
  const int frames = FrameList(spec).count();
  if (samples_per_frame > kMaxJobSamples / frames) {
    return absl::InvalidArgumentError(absl::StrCat(frames, " frames with ", samples_per_frame,
                                                   " camera samples each is more than ", kMaxJobSamples,
                                                   " camera samples"));
  }
  if (absl::Status status = CheckTileOrder(spec); !status.ok()) return status;
  const int64_t units = FrameUnits(spec).count();
  if (units > kMaxUnitsPerFrame) {
    return absl::InvalidArgumentError(absl::StrCat("tile_size ", spec.tile_size(), " with pass_samples ",
                                                   spec.pass_samples(), " cuts a frame into ", units,
                                                   " units, more than ", kMaxUnitsPerFrame));
  }
  if (spec.planning().mode() == v1::PLAN_MODE_FULL) {
    absl::StatusOr<v1::Plan> plan = FullPlan(spec);
    if (!plan.ok()) return plan.status();
    *spec.mutable_plan() = *std::move(plan);
  }
  return spec;
}

std::set<std::string> FilesOf(const v1::SceneRef& scene) {
  std::set<std::string> files = {scene.file().sha256()};
  for (const v1::AssetRef& asset : scene.dependencies()) files.insert(asset.sha256());
  return files;
}

}  // namespace lumifold::job
