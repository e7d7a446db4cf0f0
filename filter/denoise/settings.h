#pragma once

#include <string_view>
#include <vector>

#include "filter/denoise/firefly.h"
#include "filter/edges/regression.h"
#include "filter/layers/choice.h"
#include "filter/layers/nlm_space.h"
#include "filter/layers/product.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One filtering of a layer's mean, without candidates to choose from. The defaults are the paper's.
struct SingleFilteringParams {
  float range_factor = 1.8f;  // sigma_q over the layer's noise
  ManifoldParams manifolds;
};

/// A further filtering of what the first one leaves.
struct TwicingParams {
  float range_factor = 0.3f;  // sigma_q over the noise of the half that guides
  float reach_px = 6;
  ManifoldParams manifolds = {.sigma_s = 2, .height = 4};
};

/// How one layer is filtered. The defaults are those of the "default" method.
struct LayerSettings {
  PatchParams patches;                           // of the noisy layer
  PatchParams second_patches = {1, 3, 6, 0.95};  // of the first filtering's result
  float range_factor = 1.8f;  // sigma_q of the first filtering, over the noise of the half that guides
  float knee = 0.2f;          // of the stabilised guide, over the layer's mean
  // The manifolds of both filterings are close to each other, since they have to follow fine detail.
  ManifoldParams first_manifolds = {.sigma_s = 7, .height = 5, .cell = 4, .is_first_order = true};
  float first_reach_px = 12;
  /// From the smoothest to the sharpest.
  std::vector<TwicingParams> twicings = {{.range_factor = 0.6f, .reach_px = 24},
                                         {.range_factor = 0.3f, .reach_px = 8}};
  /// Range of the features that a fragment shares with its pixel, whose patch mixes surfaces, over that of its own.
  float mixed_range = 2;
  FireflyParams fireflies;
  ChoiceParams choice;
  /// Where one half alone is known, its noise is a rough guess, and geometry guides far better than patches.
  SingleFilteringParams single = {.range_factor = 8, .manifolds = {.sigma_s = 8, .height = 5}};
};

/// How a frame is filtered.
struct Settings {
  LayerSettings layer;
  RegressionParams regression;
  ProductParams products;
};

/// The "default" method's settings.
Settings DefaultSettings();

/// A number of the default method that was chosen by measurement. Halving and doubling it has a meaning.
struct TunedConstant {
  std::string_view name;
  std::string_view unit;  // "" for a pure number
  float (*get)(const Settings&);
  void (*set)(Settings*, float);
};

/// The tuned constants of the default method.
const std::vector<TunedConstant>& TunedConstants();

}  // namespace lumifold::filter
