#include "filter/denoise/layer_points.h"

#include <algorithm>
#include <utility>

namespace lumifold::filter {

SlicePoints PointsOf(const LayerFragments& fragments, float mixed_range, size_t h, std::vector<float> light) {
  SlicePoints points;
  points.pixels = fragments.places;
  points.own_features = fragments.own_features;
  points.features = fragments.features;
  points.pixel_divisor = mixed_range * mixed_range;
  points.signals = std::move(light);
  points.weights = fragments.share[h];
  return points;
}

ChoicePoints PointsToCompare(const LayerState& state, std::array<std::vector<float>, 2> light) {
  const LayerFragments& fragments = state.fragments;
  ChoicePoints points{.places = fragments.places, .weights = {}, .samples = {}, .noisy = std::move(light)};
  for (size_t i = 0; i < fragments.places.size(); ++i) {
    const auto& [x, y] = fragments.places[i];
    const bool has_both = fragments.share[0][i] > 0 && fragments.share[1][i] > 0;
    const float covered = 0.5f * (fragments.coverage[0][i] + fragments.coverage[1][i]);
    const float share = 0.5f * (fragments.share[0][i] + fragments.share[1][i]);
    points.weights.push_back(has_both ? covered * covered : 0.0f);
    points.samples.push_back(std::max(1.0f, share * state.halves.samples.At(x, y)));
  }
  return points;
}

std::array<std::vector<float>, 2> UncutLight(const LayerState& state) {
  std::array<std::vector<float>, 2> light = state.fragments.noisy;
  for (std::vector<float>& half : light) {
    for (float& value : half) value /= state.halves.scale;
  }
  return light;
}

}  // namespace lumifold::filter
