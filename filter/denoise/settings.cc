#include "filter/denoise/settings.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace lumifold::filter {
namespace {

constexpr std::string_view kManifolds = "manifolds";  // of a tree of height h: 2^h - 1

}  // namespace

Settings DefaultSettings() {
  Settings settings;
  settings.products = {
      .ranges = {.normal = 0.25f}, .cuts_frame = true, .has_levels = true, .remainder_sees_levels = true};
  return settings;
}

float TunedConstant::Get(Settings settings) const {
  const float value =
      std::visit([](const auto* number) { return static_cast<float>(*number); }, at(settings));
  return unit == kManifolds ? std::exp2(value) - 1 : value;
}

void TunedConstant::Set(Settings* settings, float value) const {
  const float stored = unit == kManifolds ? std::log2(value + 1) : value;
  std::visit(
      [&](auto* number) {
        using Type = std::remove_pointer_t<decltype(number)>;
        *number = static_cast<Type>(std::is_integral_v<Type> ? std::max(1.0f, std::round(stored)) : stored);
      },
      at(*settings));
}

const std::vector<TunedConstant>& TunedConstants() {
  using Number = TunedConstant::Number;
  static const std::vector<TunedConstant> constants = {
      {"patch-radius", "px", [](Settings& s) { return Number(&s.layer.patches.radius); }},
      {"patch-dimensions", "", [](Settings& s) { return Number(&s.layer.patches.most_dimensions); }},
      {"explained-variance", "", [](Settings& s) { return Number(&s.layer.patches.explained_variance); }},
      {"second-patch-radius", "px", [](Settings& s) { return Number(&s.layer.second_patches.radius); }},
      {"knee", "mean of the layer", [](Settings& s) { return Number(&s.layer.knee); }},
      {"reach", "px", [](Settings& s) { return Number(&s.layer.reach_px); }},
      {"first-range", "noise of the guide", [](Settings& s) { return Number(&s.layer.range_factor); }},
      {"first-spacing", "px", [](Settings& s) { return Number(&s.layer.first_manifolds.sigma_s); }},
      {"first-manifolds", "manifolds", [](Settings& s) { return Number(&s.layer.first_manifolds.height); }},
      {"slope-ridge", "squared reach",
       [](Settings& s) { return Number(&s.layer.first_manifolds.slope_ridge); }},
      {"second-range", "noise of the guide",
       [](Settings& s) { return Number(&s.layer.twicing_ranges.front()); }},
      {"third-range", "noise of the guide",
       [](Settings& s) { return Number(&s.layer.twicing_ranges.back()); }},
      {"twicing-spacing", "px", [](Settings& s) { return Number(&s.layer.twicing_manifolds.sigma_s); }},
      {"twicing-manifolds", "manifolds",
       [](Settings& s) { return Number(&s.layer.twicing_manifolds.height); }},
      {"single-range", "noise of the layer",
       [](Settings& s) { return Number(&s.layer.single.range_factor); }},
      {"single-reach", "px", [](Settings& s) { return Number(&s.layer.single.manifolds.sigma_s); }},
      {"single-manifolds", "manifolds", [](Settings& s) { return Number(&s.layer.single.manifolds.height); }},
      {"mixed-range", "range", [](Settings& s) { return Number(&s.layer.mixed_range); }},
      {"mixed-albedo", "", [](Settings& s) { return Number(&s.mixed_albedo); }},
      {"sigma-normal", "chord of unit normals",
       [](Settings& s) { return Number(&s.products.ranges.normal); }},
      {"sigma-log-depth", "logarithm of the distance",
       [](Settings& s) { return Number(&s.products.ranges.log_depth); }},
      {"sigma-roughness", "", [](Settings& s) { return Number(&s.products.ranges.roughness); }},
      {"widest-window", "px", [](Settings& s) { return Number(&s.layer.choice.widest_radius); }},
      {"wide-window", "px", [](Settings& s) { return Number(&s.layer.choice.wide_radius); }},
      {"narrow-window", "px", [](Settings& s) { return Number(&s.layer.choice.narrow_radius); }},
      {"blend-radius", "px", [](Settings& s) { return Number(&s.layer.choice.blend_radius); }},
      {"significance", "squared standard errors",
       [](Settings& s) { return Number(&s.layer.choice.significance); }},
      {"dim", "mean of the layer", [](Settings& s) { return Number(&s.layer.choice.dim); }},
      {"firefly-radius", "px", [](Settings& s) { return Number(&s.layer.fireflies.radius); }},
      {"firefly-quantile", "", [](Settings& s) { return Number(&s.layer.fireflies.quantile); }},
      {"firefly-excess", "", [](Settings& s) { return Number(&s.layer.fireflies.excess); }},
      {"firefly-sigmas", "standard deviations",
       [](Settings& s) { return Number(&s.layer.fireflies.sigmas); }},
      {"firefly-light", "stabilised light",
       [](Settings& s) { return Number(&s.layer.fireflies.spread_light); }},
      {"firefly-manifolds", "manifolds",
       [](Settings& s) { return Number(&s.layer.fireflies.spread_height); }},
      {"fit-reach", "px", [](Settings& s) { return Number(&s.layer.regression.sigma_px); }},
      {"fit-light", "stabilised light", [](Settings& s) { return Number(&s.layer.regression.sigma_light); }},
      {"fit-slope", "F over the unit of a term",
       [](Settings& s) { return Number(&s.layer.regression.slope); }},
  };
  return constants;
}

}  // namespace lumifold::filter
