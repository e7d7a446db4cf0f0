#include "filter/denoise/layer_device.h"

#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "filter/denoise/layer_points.h"
#include "filter/manifold/filter_device.h"

namespace lumifold::filter {
namespace {

HalvesOfLayer HalvesOf(const Halves& halves) {
  return {.light = {ViewsOf(halves.a), ViewsOf(halves.b)},
          .masks = {halves.weight_a.view(), halves.weight_b.view()},
          .weight = halves.weight.view(),
          .share_a = halves.share_a.view(),
          .samples = halves.samples.view(),
          .picture_light = halves.picture_light.view(),
          .expected_difference = halves.expected_difference.view(),
          .is_mixed = halves.is_mixed.view(),
          .level = halves.level};
}

GuidedHalves FirstOf(const LayerState& state) {
  const LayerSettings& settings = state.settings;
  return {settings.first_manifolds, settings.patches, settings.range_factor * state.guide_noise, {1}};
}

/// Without scales where there are no second filterings.
GuidedHalves FurtherOf(const LayerState& state) {
  const LayerSettings& settings = state.settings;
  const float widest = settings.twicing_ranges.front();
  GuidedHalves further = {
      settings.twicing_manifolds, settings.second_patches, widest * state.guide_noise, {}};
  if (state.halves.is_difference || IsOff(state.off, "second-filtering")) return further;
  for (const float range : settings.twicing_ranges) further.scales.push_back(widest / range);
  return further;
}

std::optional<RemovedLight> RemovedOf(const LayerState& state) {
  if (state.removed[0].empty()) return std::nullopt;
  const FireflyParams& fireflies = state.settings.fireflies;
  return RemovedLight{.planes = {ViewsOf(state.removed[0]), ViewsOf(state.removed[1])},
                      .returns = !IsOff(state.off, "firefly-energy"),
                      .spread_light = fireflies.spread_light,
                      .spread_height = fireflies.spread_height};
}

Candidate PictureOf(LayerResult* result) {
  auto& [a, b] = result->halves;
  return {
      std::move(a.filtered), std::move(b.filtered), {std::move(a.points.values), std::move(b.points.values)}};
}

}  // namespace

bool FilterOnDevice(LayerState* state) {
  FilterDevice* const device = DeviceOf(state->pool);
  const Halves& halves = state->halves;
  if (device == nullptr || halves.weight.view().IsEmpty() || IsOff(state->off, "choice")) return false;
  const LayerFragments& fragments = state->fragments;
  const float range = state->settings.mixed_range;
  const std::array<SlicePoints, 2> points = {PointsOf(fragments, range, 0, fragments.light[0]),
                                             PointsOf(fragments, range, 1, fragments.light[1])};
  const std::array<std::vector<float>, 2> uncut = UncutLight(*state);
  const ChoicePoints compared = PointsToCompare(*state, {});
  LayerCall call = {.halves = HalvesOf(halves),
                    .points = {.of_halves = {},
                               .uncut = {uncut[0], uncut[1]},
                               .coverage = {fragments.coverage[0], fragments.coverage[1]},
                               .offsets = fragments.offsets,
                               .weights = compared.weights,
                               .samples = compared.samples},
                    .geometry = ViewsOf(state->geometry),
                    .knee = state->settings.knee,
                    .reach_px = state->settings.reach_px,
                    .first = FirstOf(*state),
                    .further = FurtherOf(*state),
                    .choice = state->settings.choice,
                    .fit = std::nullopt,
                    .removed = RemovedOf(*state),
                    .may_stay_noisy = !IsOff(state->off, "noisy-choice")};
  if (!fragments.IsEmpty()) call.points.of_halves = {&points[0], &points[1]};
  if (!halves.is_difference && !call.halves.is_mixed.IsEmpty() && !IsOff(state->off, "light-regression"))
    call.fit = state->settings.regression;
  std::optional<LayerResult> result = device->FilterLayer(call);
  if (!result.has_value()) return false;
  state->result = PictureOf(&*result);
  state->returned = std::move(result->returned);
  state->is_done = true;
  return true;
}

}  // namespace lumifold::filter
