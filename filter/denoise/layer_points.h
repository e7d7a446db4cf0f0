#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "filter/denoise/layer_stages.h"
#include "filter/layers/choice.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

// The fragments of a layer as its stages take them. Index 0 of a pair is half A, 1 is half B.

/// As points of the manifolds of half h, with `light` as signals.
SlicePoints PointsOf(const LayerFragments& fragments, float mixed_range, size_t h, std::vector<float> light);

/// The noisy layer at the fragments: `light`, in the halves' unit.
ChoicePoints PointsToCompare(const LayerState& state, std::array<std::vector<float>, 2> light);

/// Their light in the halves' unit, fireflies included.
std::array<std::vector<float>, 2> UncutLight(const LayerState& state);

}  // namespace lumifold::filter
