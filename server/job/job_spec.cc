#include "server/job/job_spec.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "server/job/frame_list.h"
#include "server/job/limits.h"
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
  if (spec.ByteSizeLong() <= kMaxSpecBytes) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("the spec has ", spec.ByteSizeLong(), " bytes, more than ", kMaxSpecBytes));
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
  const auto& files = spec.scene().dependencies();
  if (std::none_of(files.begin(), files.end(),
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

absl::Status CheckNumbers(const v1::JobSpec& spec) {
  for (const absl::Status& status : {
           CheckRange("width", spec.width(), 1, kMaxEdge),
           CheckRange("height", spec.height(), 1, kMaxEdge),
           FrameList::Check(spec),
           CheckRange("samples_per_pixel", spec.samples_per_pixel(), 1, kMaxSamples),
           CheckRange("max_bounces", spec.max_bounces(), 0, kMaxBounces),
           CheckRange("tile_size", spec.tile_size(), kMinTileSize, kMaxTileSize),
           CheckRange("pass_samples", spec.pass_samples(), 2, kMaxSamples),
           CheckPositive("frames_per_second", spec.frames_per_second()),
       }) {
    if (!status.ok()) return status;
  }
  if (spec.pass_samples() % 2 != 0) {
    return absl::InvalidArgumentError(absl::StrCat("pass_samples is ", spec.pass_samples(), ", not even"));
  }
  return absl::OkStatus();
}

/// Even, because samples alternate between the halves.
int DefaultPassSamples(int samples_per_pixel) {
  const int share = samples_per_pixel / kDefaultMaxPasses;
  return std::max(kMinDefaultPassSamples, share + share % 2);
}

}  // namespace

absl::StatusOr<v1::JobSpec> NormaliseJobSpec(v1::JobSpec spec) {
  if (spec.tile_size() == 0) spec.set_tile_size(kDefaultTileSize);
  if (spec.pass_samples() == 0) spec.set_pass_samples(DefaultPassSamples(spec.samples_per_pixel()));
  if (spec.frames_per_second() == 0) spec.set_frames_per_second(kDefaultFramesPerSecond);
  if (spec.filter().method().empty()) spec.mutable_filter()->set_method("default");
  if (absl::Status status = CheckNumbers(spec); !status.ok()) return status;
  if (absl::Status status = CheckTexts(spec); !status.ok()) return status;
  if (absl::Status status = CheckScene(spec.scene()); !status.ok()) return status;
  if (absl::Status status = CheckEnvironment(spec); !status.ok()) return status;
  if (absl::Status status = CheckLens(spec); !status.ok()) return status;
  const int64_t samples_per_frame = int64_t{spec.width()} * spec.height() * spec.samples_per_pixel();
  const int frames = FrameList(spec).count();
  if (samples_per_frame > kMaxJobSamples / frames) {
    return absl::InvalidArgumentError(absl::StrCat(frames, " frames with ", samples_per_frame,
                                                   " camera samples each is more than ", kMaxJobSamples,
                                                   " camera samples"));
  }
  const int64_t units = FrameUnits(spec).count();
  if (units > kMaxUnitsPerFrame) {
    return absl::InvalidArgumentError(absl::StrCat("tile_size ", spec.tile_size(), " with pass_samples ",
                                                   spec.pass_samples(), " cuts a frame into ", units,
                                                   " units, more than ", kMaxUnitsPerFrame));
  }
  return spec;
}

}  // namespace lumifold::job
