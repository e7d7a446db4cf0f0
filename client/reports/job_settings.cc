#include "client/reports/job_settings.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "absl/time/time.h"
#include "client/cli/frame_range.h"
#include "client/scene/assets.h"
#include "proto/rpc/bounded_text.h"

namespace lumifold::client {
namespace {

using Json = nlohmann::ordered_json;

std::string SizeText(int width, int height) { return absl::StrCat(width, "x", height); }

/// As it was written.
double Plain(float value) {
  double plain = 0;
  return absl::SimpleAtod(absl::StrCat(value), &plain) ? plain : static_cast<double>(value);
}

void AddPicture(const v1::JobStatus& status, Json* json) {
  const v1::JobSpec& settings = status.settings();
  if (settings.has_crop()) {
    const v1::Crop& crop = settings.crop();
    (*json)["size"] = SizeText(crop.frame_width(), crop.frame_height());
    (*json)["region"] = absl::StrCat(crop.x(), ",", crop.y(), ",", crop.x() + status.width(), ",",
                                     crop.y() + status.height());
  } else {
    (*json)["size"] = SizeText(status.width(), status.height());
  }
  std::vector<FrameRange> frames = {{status.first_frame(), status.first_frame() + status.frame_count() - 1}};
  for (const v1::FrameRange& range : status.more_frames())
    frames.push_back({range.first(), range.first() + range.count() - 1});
  (*json)["frames"] = TextOf(frames);
  (*json)["fps"] = settings.frames_per_second();
  for (const PixelFilterChoice& choice : kPixelFilters) {
    if (!settings.has_pixel_filter() || settings.pixel_filter().kind() != choice.kind) continue;
    (*json)["pixel-filter"] = choice.name;
    (*json)["pixel-filter-width"] = Plain(settings.pixel_filter().width());
  }
}

void AddSampling(const v1::JobStatus& status, Json* json) {
  (*json)["spp"] = status.samples_per_pixel();
  if (status.has_adaptive()) {
    const v1::AdaptiveSampling& adaptive = status.adaptive();
    (*json)["adaptive"] = true;
    if (adaptive.target_error() > 0) {
      (*json)["target-error"] = adaptive.target_error();
      (*json)["target-metric"] = adaptive.metric() == v1::ERROR_METRIC_REL_MSE ? kRelMse : kMse255;
    }
    if (adaptive.time_seconds() > 0)
      (*json)["time"] = absl::FormatDuration(absl::Seconds(adaptive.time_seconds()));
    if (!adaptive.schedule().empty()) (*json)["schedule"] = absl::StrJoin(adaptive.schedule(), ",");
  }
  (*json)["seed"] = status.settings().seed();
  (*json)["max-bounces"] = status.settings().max_bounces();
  (*json)["method"] = status.settings().filter().method();
}

void AddScene(const v1::JobSpec& settings, Json* json) {
  if (!settings.camera().empty()) (*json)["camera"] = settings.camera();
  if (!settings.animation().empty()) (*json)["animation"] = settings.animation();
  if (!settings.variant().empty()) (*json)["variant"] = settings.variant();
  if (settings.keep_dark()) (*json)["env"] = kNoEnvironment;
  if (settings.has_environment()) {
    (*json)["env"] = std::string(absl::StripPrefix(settings.environment().uri(), kEnvironmentScheme));
    (*json)["env-rotate"] = Plain(settings.environment().rotate_degrees());
    (*json)["env-scale"] = Plain(settings.environment().scale());
  }
  if (settings.background() == v1::BACKGROUND_TRANSPARENT) (*json)["background"] = kTransparent;
  if (settings.ground() == v1::GROUND_SHADOW) (*json)["ground"] = kShadow;
  if (settings.has_lens()) {
    (*json)["f-stop"] = Plain(settings.lens().f_stop());
    (*json)["focus"] = Plain(settings.lens().focus_metres());
  }
}

/// A value on a command line.
std::string ShellText(const Json& value) {
  const std::string text = value.is_string() ? rpc::Printable(value.get<std::string>()) : value.dump();
  return absl::StrContains(text, ' ') ? absl::StrCat("\"", text, "\"") : text;
}

}  // namespace

Json SettingsJson(const v1::JobStatus& status) {
  Json json = Json::object();
  if (!status.has_settings()) return json;
  const v1::JobSpec& settings = status.settings();
  AddPicture(status, &json);
  AddSampling(status, &json);
  AddScene(settings, &json);
  if (settings.save_film()) json["save-film"] = true;
  if (settings.cryptomatte()) json["cryptomatte"] = true;
  if (settings.planning().mode() == v1::PLAN_MODE_FULL) json["plan"] = "full";
  if (!settings.planning().forced().empty()) json["force"] = settings.planning().forced();
  return json;
}

std::string SettingsText(const v1::JobStatus& status) {
  std::string text;
  const Json settings = SettingsJson(status);
  for (const auto& [name, value] : settings.items()) {
    if (name == "size" || name == "spp" || name == "frames") continue;
    const Json values = value.is_array() ? value : Json::array({value});
    for (const Json& each : values) {
      absl::StrAppend(&text, text.empty() ? "" : " ", "--", name);
      if (!each.is_boolean()) absl::StrAppend(&text, " ", ShellText(each));
    }
  }
  return text;
}

}  // namespace lumifold::client
