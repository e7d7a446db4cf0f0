#include "filter/denoise/settings.h"

namespace lumifold::filter {

Settings DefaultSettings() {
  Settings settings;
  settings.products = {
      .ranges = {.normal = 0.25f}, .cuts_frame = true, .has_levels = true, .remainder_sees_levels = true};
  return settings;
}

const std::vector<TunedConstant>& TunedConstants() {
  static const std::vector<TunedConstant> constants = {
      {"first-range-factor", "noise of the guide",
       [](const Settings& settings) { return settings.layer.range_factor; },
       [](Settings* settings, float value) { settings->layer.range_factor = value; }},
      {"first-reach", "px", [](const Settings& settings) { return settings.layer.first_reach_px; },
       [](Settings* settings, float value) { settings->layer.first_reach_px = value; }},
      {"second-range-factor", "noise of the guide",
       [](const Settings& settings) { return settings.layer.twicings.front().range_factor; },
       [](Settings* settings, float value) { settings->layer.twicings.front().range_factor = value; }},
      {"second-reach", "px",
       [](const Settings& settings) { return settings.layer.twicings.front().reach_px; },
       [](Settings* settings, float value) { settings->layer.twicings.front().reach_px = value; }},
      {"third-range-factor", "noise of the guide",
       [](const Settings& settings) { return settings.layer.twicings.back().range_factor; },
       [](Settings* settings, float value) { settings->layer.twicings.back().range_factor = value; }},
      {"third-reach", "px", [](const Settings& settings) { return settings.layer.twicings.back().reach_px; },
       [](Settings* settings, float value) { settings->layer.twicings.back().reach_px = value; }},
      {"knee", "mean of the layer", [](const Settings& settings) { return settings.layer.knee; },
       [](Settings* settings, float value) { settings->layer.knee = value; }},
      {"sigma-normal", "chord of unit normals",
       [](const Settings& settings) { return settings.products.ranges.normal; },
       [](Settings* settings, float value) { settings->products.ranges.normal = value; }},
      {"sigma-log-depth", "logarithm of the distance",
       [](const Settings& settings) { return settings.products.ranges.log_depth; },
       [](Settings* settings, float value) { settings->products.ranges.log_depth = value; }},
      {"significance", "squared standard errors",
       [](const Settings& settings) { return settings.layer.choice.significance; },
       [](Settings* settings, float value) { settings->layer.choice.significance = value; }},
  };
  return constants;
}

}  // namespace lumifold::filter
