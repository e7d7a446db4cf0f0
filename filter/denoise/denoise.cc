#include "filter/denoise/denoise.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/denoise/frame_stages.h"
#include "filter/denoise/layer_stages.h"
#include "filter/image/check.h"

namespace lumifold::filter {
namespace {

/// The picture, and what its stages changed.
struct Changed {
  Picture picture;
  FrameChange change;
  Planes returned;
};

Settings SettingsWith(const DenoiseOptions& options) {
  LUMIFOLD_CHECK(CheckSwitchedOff(options.off).ok());
  Settings settings = DefaultSettings();
  for (const GuideInfo& guide : Guides()) {
    if (IsOff(options.off, guide.name)) guide.turn_off(&settings);
  }
  if (options.adjust) options.adjust(&settings);
  return settings;
}

Changed Run(const Frame& frame, const DenoiseOptions& options, TaskPool* pool) {
  const Settings settings = SettingsWith(options);
  FrameState state{.frame = frame,
                   .settings = settings,
                   .layer_stages = DefaultLayerStages(),
                   .off = options.off,
                   .watch = options.watch,
                   .progress = {options.progress},
                   .pool = pool,
                   .fragments = {},
                   .mixed = {},
                   .hits = {},
                   .rest = {},
                   .change = {},
                   .returned = {},
                   .candidates = {},
                   .picture = {}};
  for (const FrameStage& stage : DefaultFrameStages()) {
    if (IsOff(options.off, stage.info.name) || !stage.is_on(state)) continue;
    stage.run(&state);
    if (options.watch) options.watch(stage.info.name);
  }
  return {std::move(state.picture), std::move(state.change), std::move(state.returned)};
}

std::vector<StageInfo> ListStages() {
  std::vector<StageInfo> all;
  for (const FrameStage& stage : DefaultFrameStages()) {
    all.push_back(stage.info);
    if (stage.info.name != "layers") continue;
    for (const LayerStage& of_layer : DefaultLayerStages()) all.push_back(of_layer.info);
  }
  return all;
}

}  // namespace

int BlurWindow(float sigma_px) {
  const double falloff = std::log(200.0) / std::sqrt(2.0);
  return static_cast<int>(std::ceil(falloff * static_cast<double>(sigma_px)));
}

bool IsOff(const SwitchedOff& off, std::string_view name) {
  return std::find(off.begin(), off.end(), name) != off.end();
}

Picture Denoise(const Frame& frame, TaskPool* pool, const DenoiseOptions& options) {
  return std::move(Run(frame, options, pool).picture);
}

FilteredPicture DenoiseWithDeviation(const Frame& frame, TaskPool* pool, const DenoiseOptions& options) {
  Changed changed = Run(frame, options, pool);
  return {std::move(changed.picture), DeviationOf(frame, changed.change, pool),
          DeviationOfReturned(frame, changed.returned, pool)};
}

FilteredPicture DenoiseToEstimate(const Frame& frame, TaskPool* pool) {
  return DenoiseWithDeviation(frame, pool, {.off = {"second-filtering"}});
}

const std::vector<StageInfo>& Stages() {
  static const std::vector<StageInfo> stages = ListStages();
  return stages;
}

const std::vector<GuideInfo>& Guides() {
  static const std::vector<GuideInfo> guides = {
      {"patches", "coordinates of patches in the NLM space; else geometry alone guides",
       [](Settings* settings) {
         for (PatchParams* patches : {&settings->layer.patches, &settings->layer.second_patches})
           patches->least_dimensions = patches->most_dimensions = 0;
       }},
      {"normals", "normals among the features",
       [](Settings* settings) { settings->products.ranges.normal = std::numeric_limits<float>::infinity(); }},
      {"depth", "depth among the features",
       [](Settings* settings) {
         settings->products.ranges.log_depth = std::numeric_limits<float>::infinity();
       }},
      {"first-order", "planes fitted through the light, not means",
       [](Settings* settings) { settings->layer.first_manifolds.is_first_order = false; }},
      {"levels", "mirrors and glass filtered level by level, else with the remainder",
       [](Settings* settings) {
         settings->products.has_levels = false;
         settings->products.remainder_sees_levels = false;
       }}};
  return guides;
}

absl::Status CheckSwitchedOff(const SwitchedOff& off) {
  for (const std::string& name : off) {
    const bool is_guide = std::any_of(Guides().begin(), Guides().end(),
                                      [&](const GuideInfo& guide) { return guide.name == name; });
    const bool is_stage = std::any_of(Stages().begin(), Stages().end(), [&](const StageInfo& stage) {
      return stage.name == name && !stage.is_required;
    });
    if (!is_guide && !is_stage)
      return absl::InvalidArgumentError(
          absl::StrCat("no stage that can be switched off is named '", name, "'"));
  }
  return absl::OkStatus();
}

int DenoiseApron() {
  const Settings settings = DefaultSettings();
  int widest = 0;
  for (const StageInfo& stage : Stages()) {
    if (stage.window_px != nullptr) widest = std::max(widest, stage.window_px(settings));
  }
  return widest;
}

}  // namespace lumifold::filter
