#include "filter/denoise/settings.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace lumifold::filter {
namespace {

template <typename Number>
Number RoundTo(float value) {
  return static_cast<Number>(std::is_integral_v<Number> ? std::max(1.0f, std::round(value)) : value);
}

/// `At(settings)`: a reference to the number.
template <auto At>
constexpr TunedConstant Constant(std::string_view name, std::string_view unit) {
  return {name, unit, [](const Settings& settings) { return static_cast<float>(At(settings)); },
          [](Settings* settings, float value) {
            auto& number = At(*settings);
            number = RoundTo<std::remove_reference_t<decltype(number)>>(value);
          }};
}

/// A height of a tree, as the number of its manifolds, 2^height - 1.
template <auto At>
constexpr TunedConstant Manifolds(std::string_view name) {
  return {name, "manifolds",
          [](const Settings& settings) { return std::exp2(static_cast<float>(At(settings))) - 1; },
          [](Settings* settings, float value) { At(*settings) = RoundTo<int>(std::log2(value + 1)); }};
}

}  // namespace

Settings DefaultSettings() {
  Settings settings;
  settings.products = {
      .ranges = {.normal = 0.25f}, .cuts_frame = true, .has_levels = true, .remainder_sees_levels = true};
  return settings;
}

const std::vector<TunedConstant>& TunedConstants() {
  static const std::vector<TunedConstant> constants = {
      Constant < [](auto& s) -> auto& {return s.layer.patches.radius;
}
> ("patch-radius", "px"), Constant < [](auto& s) -> auto& { return s.layer.patches.most_dimensions; }
> ("patch-dimensions", ""), Constant < [](auto& s) -> auto& { return s.layer.patches.explained_variance; }
> ("explained-variance", ""), Constant < [](auto& s) -> auto& { return s.layer.second_patches.radius; }
> ("second-patch-radius", "px"), Constant < [](auto& s) -> auto& { return s.layer.knee; }
> ("knee", "mean of the layer"), Constant < [](auto& s) -> auto& { return s.layer.range_factor; }
> ("first-range", "noise of the guide"), Constant < [](auto& s) -> auto& {
  return s.layer.first_manifolds.sigma_s;
}
> ("first-spacing", "px"), Manifolds < [](auto& s) -> auto& { return s.layer.first_manifolds.height; }
> ("first-manifolds"), Constant < [](auto& s) -> auto& { return s.layer.first_reach_px; }
> ("first-reach", "px"), Constant < [](auto& s) -> auto& { return s.layer.twicings.front().range_factor; }
> ("second-range", "noise of the guide"), Constant < [](auto& s) -> auto& {
  return s.layer.twicings.front().manifolds.sigma_s;
}
> ("second-spacing", "px"), Manifolds < [](auto& s) -> auto& {
  return s.layer.twicings.front().manifolds.height;
}
> ("second-manifolds"), Constant < [](auto& s) -> auto& { return s.layer.twicings.front().reach_px; }
> ("second-reach", "px"), Constant < [](auto& s) -> auto& { return s.layer.twicings.back().range_factor; }
> ("third-range", "noise of the guide"), Constant < [](auto& s) -> auto& {
  return s.layer.twicings.back().reach_px;
}
> ("third-reach", "px"), Constant < [](auto& s) -> auto& { return s.layer.single.range_factor; }
> ("single-range", "noise of the layer"), Constant < [](auto& s) -> auto& {
  return s.layer.single.manifolds.sigma_s;
}
> ("single-reach", "px"), Constant < [](auto& s) -> auto& { return s.layer.mixed_range; }
> ("mixed-range", "range"), Constant < [](auto& s) -> auto& { return s.products.ranges.normal; }
> ("sigma-normal", "chord of unit normals"), Constant < [](auto& s) -> auto& {
  return s.products.ranges.log_depth;
}
> ("sigma-log-depth", "logarithm of the distance"), Constant < [](auto& s) -> auto& {
  return s.products.ranges.mirror_normal;
}
> ("sigma-mirror-normal", "chord of unit normals"), Constant < [](auto& s) -> auto& {
  return s.products.ranges.roughness;
}
> ("sigma-roughness", ""), Constant < [](auto& s) -> auto& { return s.layer.choice.widest_radius; }
> ("widest-window", "px"), Constant < [](auto& s) -> auto& { return s.layer.choice.wide_radius; }
> ("wide-window", "px"), Constant < [](auto& s) -> auto& { return s.layer.choice.narrow_radius; }
> ("narrow-window", "px"), Constant < [](auto& s) -> auto& { return s.layer.choice.blend_radius; }
> ("blend-radius", "px"), Constant < [](auto& s) -> auto& { return s.layer.choice.significance; }
> ("significance", "squared standard errors"), Constant < [](auto& s) -> auto& { return s.layer.choice.dim; }
> ("dim", "mean of the layer"), Constant < [](auto& s) -> auto& { return s.layer.fireflies.radius; }
> ("firefly-radius", "px"), Constant < [](auto& s) -> auto& { return s.layer.fireflies.excess; }
> ("firefly-excess", ""), Constant < [](auto& s) -> auto& { return s.layer.fireflies.noise_radius; }
> ("firefly-noise-radius", "px"), Constant < [](auto& s) -> auto& { return s.layer.fireflies.sigmas; }
> ("firefly-sigmas", "standard deviations"), Constant < [](auto& s) -> auto& {
  return s.layer.fireflies.spread_px;
}
> ("firefly-reach", "px"), Constant < [](auto& s) -> auto& { return s.layer.fireflies.spread_light; }
> ("firefly-light", "stabilised light"), Manifolds < [](auto& s) -> auto& {
  return s.layer.fireflies.spread_height;
}
> ("firefly-manifolds"), Constant < [](auto& s) -> auto& { return s.regression.sigma_px; }
> ("fit-reach", "px"), Constant < [](auto& s) -> auto& { return s.regression.sigma_light; }
> ("fit-light", "stabilised light"), Constant < [](auto& s) -> auto& { return s.regression.knee; }
> ("fit-knee", "mean of the picture"), Constant < [](auto& s) -> auto& { return s.regression.slope; }
> ("fit-slope", "F over the unit of a term"), Constant < [](auto& s) -> auto& {
  return s.regression.distance_scale;
}
> ("fit-distance", ""),
};  // namespace lumifold::filter
return constants;
}

}  // namespace lumifold::filter
